//! `palpate report`: writes a page about a sensor's runs, or about many sensors side by side.

use super::output::OutputArgs;
use super::summary::note;
use super::verdict::verdict_code;
use crate::api::{self, Failure, ReportOptions};
use serde_json::json;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate report runs/paper
  palpate report runs/characterise runs/calibrate runs/test --out A-017.html
  palpate report runs/calibrate runs/test --same-sensor --accept example/accept.toml
  palpate report --compare runs/batch-* --out batch.html
  palpate report runs/paper --figures figures

The files of example/ are written by `palpate init example --from example`.

All runs of a page must be of one sensor, with each phase in one run. The page is one
self-contained file: it opens without a network and can be printed. --figures
also saves each figure as an SVG file in light colours, and its numbers
as a CSV file of the same name.";

/// Write a page about one run, or a comparison of many
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ReportArgs {
    #[command(flatten)]
    pub options: ReportOptions,
    #[command(flatten)]
    pub output: OutputArgs,
}

/// Writes the page, and prints a line with its results. The exit code is the verdict's; that of a comparison is 0.
pub(super) fn report(args: &ReportArgs) -> Result<ExitCode, Failure> {
    let report = api::report(&args.options, &note)?;
    report.write_page()?;
    let (out, summary, kb) = (report.out.display(), &report.summary, report.html.len() as f64 / 1000.0);
    args.output.text(&format!("{summary}\n{out}: {kb:.0} kB\n"))?;
    if let Some(figures) = report.write_figures()? {
        args.output.text(&figures)?;
    }
    args.output.object(&json!({ "page": report.out, "figures": args.options.figures, "result": report.result }))?;
    Ok(verdict_code(report.judgement.as_ref()))
}
