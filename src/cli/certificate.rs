//! `palpate certificate`: writes the calibration certificate of a sensor, as a page and as a Digital Calibration Certificate.

use super::exit::Failure;
use super::output::OutputArgs;
use super::recorded::read_run;
use super::report::{judged, write};
use super::sources::read;
use super::tables::filled;
use super::verdict::AcceptArgs;
use palpate_report::report::certificate::{Certificate, parse};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate certificate runs/paper --with example/certificate.toml
  palpate certificate runs/calibrate runs/test --with example/certificate.toml --out A-017
  palpate verify runs/paper --certificate runs/paper/certificate.xml

The files of example/ are written by `palpate init example --from example`.

Writes OUT.html, which prints on A4, and OUT.xml, a Digital Calibration
Certificate of the PTB (schema 3.2.0, units in D-SI). It isn't signed: the SHA-256
of the journals is on it.";

/// Write the calibration certificate of a sensor
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CertificateArgs {
    /// The run folders of the sensor
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// TOML file with laboratory, customer, item and procedure
    #[arg(long, value_name = "FILE")]
    with: Option<PathBuf>,
    /// Output path without extension [default: certificate in the first run's folder]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Treat runs without a sensor ID as runs of the same sensor
    #[arg(long)]
    same_sensor: bool,
    #[command(flatten)]
    accept: AcceptArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes both documents.
pub(super) fn certificate(args: &CertificateArgs) -> Result<ExitCode, Failure> {
    let out = args.out.clone().unwrap_or_else(|| args.runs[0].join("certificate"));
    let (html, xml) = (with_ending(&out, "html"), with_ending(&out, "xml"));
    check_free(&html)?;
    check_free(&xml)?;
    let with = args.with.as_ref().ok_or_else(|| {
        let help = "`palpate init FOLDER` writes a certificate.toml to fill in; then add --with certificate.toml";
        Failure::usage(miette::miette!(help = help, "laboratory, customer, item and procedure aren't given"))
    })?;
    let given = parse(&with.display().to_string(), &read(with)?).map_err(Failure::usage)?;
    let runs = args.runs.iter().map(|run| read_run(run)).collect::<Result<Vec<_>, Failure>>()?;
    let (subject, judged) = judged(runs, args.same_sensor, &args.accept)?;
    let certificate = Certificate::of(&subject, &judged, &given).map_err(Failure::usage)?;
    // the one that programs read first: the page says the same
    write(&xml, &certificate.xml())?;
    write(&html, &certificate.html())?;
    let text = format!("{}{}\n{}\n", filled(&certificate.told(), "  "), html.display(), xml.display());
    let content = json!({ "result": certificate.told(), "files": [html, xml], "verdict": judged.verdict() });
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
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
