//! The calibration certificate of a sensor, as a page and as a Digital Calibration Certificate.

use super::accept::AcceptOptions;
use super::recorded::read_run;
use super::report::{judged, write};
use super::sources::read;
use super::{Failure, Note};
use palpate_data::acceptance::SensorVerdict;
use palpate_report::report::certificate::{Certificate, parse};
use std::path::{Path, PathBuf};

/// Runs of a certificate, and where it is written.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct CertificateOptions {
    /// The run folders of the sensor
    #[arg(required = true)]
    pub runs: Vec<PathBuf>,
    /// TOML file with laboratory, customer, item and procedure
    #[arg(long, value_name = "FILE")]
    pub with: Option<PathBuf>,
    /// Output path without extension [default: certificate in the first run's folder]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Treat runs without a sensor ID as runs of the same sensor
    #[arg(long)]
    pub same_sensor: bool,
    /// The rule, if it isn't that of the recipe.
    #[command(flatten)]
    pub accept: AcceptOptions,
}

/// A certificate that is written.
pub struct Certified {
    /// Its result in a sentence.
    pub summary: String,
    /// Verdict, if there is a rule.
    pub verdict: Option<SensorVerdict>,
    /// The page.
    pub html: PathBuf,
    /// The Digital Calibration Certificate.
    pub xml: PathBuf,
}

/// Writes both documents, like `palpate certificate`. Replaces no file.
///
/// # Errors
/// Bad input, or a file that can't be written.
pub fn certificate(options: &CertificateOptions, note: Note<'_>) -> Result<Certified, Failure> {
    let first = options.runs.first().ok_or_else(|| Failure::usage(miette::miette!("no run is named")))?;
    let out = options.out.clone().unwrap_or_else(|| first.join("certificate"));
    let (html, xml) = (with_ending(&out, "html"), with_ending(&out, "xml"));
    check_free(&html)?;
    check_free(&xml)?;
    let with = options.with.as_ref().ok_or_else(|| {
        let help = "`palpate init FOLDER` writes a certificate.toml to fill in; then add --with certificate.toml";
        Failure::usage(miette::miette!(help = help, "laboratory, customer, item and procedure aren't given"))
    })?;
    let given = parse(&with.display().to_string(), &read(with)?).map_err(Failure::usage)?;
    let runs = options.runs.iter().map(|run| read_run(run, note)).collect::<Result<Vec<_>, Failure>>()?;
    let (subject, judged) = judged(runs, options.same_sensor, &options.accept, note)?;
    let certificate = Certificate::of(&subject, &judged, &given).map_err(Failure::usage)?;
    // programs read this one first: the page has the same content
    write(&xml, &certificate.xml())?;
    write(&html, &certificate.html())?;
    Ok(Certified { summary: certificate.text(), verdict: judged.verdict(), html, xml })
}

fn with_ending(out: &Path, ending: &str) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(format!(".{ending}"));
    name.into()
}

/// An issued certificate is never replaced.
fn check_free(path: &Path) -> Result<(), Failure> {
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    let help = "choose another --out, or move it away: a certificate is never replaced";
    Err(Failure::usage(miette::miette!(help = help, "{} already exists", path.display())))
}
