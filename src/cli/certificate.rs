//! `palpate certificate`: writes the calibration certificate of a sensor, as a page and as a Digital Calibration Certificate.

use super::output::OutputArgs;
use super::summary::note;
use super::tables::filled;
use crate::api::{self, CertificateOptions, Certified, Failure};
use serde_json::json;
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
    #[command(flatten)]
    options: CertificateOptions,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes both documents.
pub(super) fn certificate(args: &CertificateArgs) -> Result<ExitCode, Failure> {
    let Certified { summary, verdict, html, xml } = api::certificate(&args.options, &note)?;
    let text = format!("{}{}\n{}\n", filled(&summary, "  "), html.display(), xml.display());
    args.output.print(&text, &json!({ "result": summary, "files": [html, xml], "verdict": verdict }))?;
    Ok(ExitCode::SUCCESS)
}
