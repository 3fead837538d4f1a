//! `palpate batch report`: writes a page about a batch, or about several batches side by side.

use super::super::output::OutputArgs;
use crate::api::Failure;
use crate::api::report::{check_free, write};
use palpate_report::report::{PageLink, batch_page, batches_page, counted};
use palpate_run::batch::{Ended, History, SensorState};
use serde_json::json;
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate batch report runs/first-batch
  palpate batch report --compare runs/june runs/july --out summer.html

The page is one self-contained file: it opens without a network and can be printed. It
is made from the batch's journal; a batch can be looked at while it is in use. Pages
and certificates of sensors are linked if they exist.";

/// Name of the page in the batch folder, and of a comparison.
const PAGE: &str = "report.html";
const COMPARISON: &str = "comparison.html";

/// Pages in a run folder that are linked.
const LINKED: [(&str, &str); 2] = [("report", "report.html"), ("certificate", "certificate.html")];

/// Write a page about a batch: yield, figures, control charts, and all sensors
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BatchReportArgs {
    /// The batch folders
    #[arg(required = true)]
    batches: Vec<PathBuf>,
    /// Compare batches: months, or benches
    #[arg(long)]
    compare: bool,
    /// Output file [default: report.html in the batch folder, or comparison.html]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Writes the page and reports in a line what is in it.
pub(super) fn report(args: &BatchReportArgs) -> Result<ExitCode, Failure> {
    if !args.compare && args.batches.len() > 1 {
        let help = "add --compare, or give one batch";
        return Err(Failure::usage(miette::miette!(help = help, "a page is about one batch")));
    }
    let default = || if args.compare { COMPARISON.into() } else { args.batches[0].join(PAGE) };
    let out = args.out.clone().unwrap_or_else(default);
    let histories = args.batches.iter().map(|path| History::read(path).map_err(Failure::batch));
    let histories: Vec<History> = histories.collect::<Result<_, Failure>>()?;
    check_free(&out)?;
    let (page, words) = match (histories.as_slice(), args.compare) {
        ([history], false) => {
            let folder = &args.batches[0];
            let to_folder = address(&out, folder);
            let accepted = history.state.count(SensorState::Accepted);
            let of = counted(history.state.items.len(), "sensor");
            (batch_page(history, &|ended| links(folder, &to_folder, ended)), format!("{accepted} of {of} accepted"))
        }
        _ => (batches_page(&histories), format!("{} compared", counted(histories.len(), "batch"))),
    };
    write(&out, &page.html)?;
    let text = format!("{words}\n{}: {:.0} kB\n", out.display(), page.html.len() as f64 / 1000.0);
    args.output.print(&text, &json!({ "page": out, "result": words }))?;
    Ok(ExitCode::SUCCESS)
}

/// Returns the links to the pages about a result that exist, each in the first run folder that has it.
fn links(folder: &Path, to_folder: &str, ended: &Ended) -> Vec<PageLink> {
    let is_inside = |run: &&String| Path::new(run).components().all(|part| matches!(part, Component::Normal(_)));
    let link = |(name, file): (&'static str, &str)| {
        let mut runs = ended.runs.iter().filter(is_inside);
        let run = runs.find(|run| folder.join(run).join(file).is_file())?;
        Some(PageLink { name, href: format!("{to_folder}{}/{file}", escaped(run)) })
    };
    LINKED.into_iter().filter_map(link).collect()
}

/// Returns the address of a folder relative to a page: empty, or with a slash at the end.
fn address(page: &Path, folder: &Path) -> String {
    let parent = page.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let whole = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or(path.to_owned());
    let (from, to) = (whole(parent), whole(folder));
    let shared = from.components().zip(to.components()).take_while(|(one, other)| one == other).count();
    let up = from.components().skip(shared).map(|_| "../".to_owned());
    let down = to.components().skip(shared).map(|part| format!("{}/", escaped(&part.as_os_str().to_string_lossy())));
    up.chain(down).collect()
}

/// Returns a path with each byte that has a meaning in an address as `%` and two digits.
fn escaped(path: &str) -> String {
    let byte = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'/' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    path.bytes().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_an_address_relative_to_the_page() {
        let folder = tempfile::tempdir().expect("a folder");
        let batch = folder.path().join("june 1");
        std::fs::create_dir_all(&batch).expect("a folder");
        assert_eq!(address(&batch.join("report.html"), &batch), "");
        assert_eq!(address(&folder.path().join("a.html"), &batch), "june%201/");
        let pages = folder.path().join("pages/of");
        std::fs::create_dir_all(&pages).expect("a folder");
        assert_eq!(address(&pages.join("a.html"), &batch), "../../june%201/");
    }
}
