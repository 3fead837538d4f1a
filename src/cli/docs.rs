//! `palpate docs`: the pages of the book, from the installed program.

use super::output::OutputArgs;
use super::summary::print;
use super::text_table::TextTable;
use super::texts::ReferencePage;
use crate::api::Failure;
use clap::ValueEnum as _;
use serde_json::json;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate docs
  palpate docs tutorials/simulation | less
  palpate docs process";

/// Print a page of the book as Markdown, or list the pages
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DocsArgs {
    /// The page, as in the list; the last part is enough
    #[arg(conflicts_with = "json")]
    page: Option<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// The index of the book: parts, and in each part its pages with their titles.
const INDEX: &str = include_str!("../../docs/SUMMARY.md");

macro_rules! pages {
    ($($name:literal),+ $(,)?) => { &[$(($name, include_str!(concat!("../../docs/", $name, ".md")))),+] };
}

/// The pages that are written by hand. Those of keys and commands are made by the program.
const PAGES: &[(&str, &str)] = pages!(
    "tutorials/simulation",
    "tutorials/hardware",
    "tutorials/own-sensor",
    "tutorials/robot",
    "how-to/recipe",
    "how-to/over-time",
    "how-to/without-load-cell",
    "how-to/own-data",
    "how-to/files",
    "how-to/own-device",
    "how-to/line-device",
    "how-to/report",
    "how-to/certificate",
    "how-to/resume",
    "how-to/batch",
    "how-to/compare-sensors",
    "how-to/adapt",
    "how-to/study",
    "how-to/python",
    "how-to/rust",
    "how-to/controller",
    "reference/run-folder",
    "reference/tables",
    "reference/drivers",
    "reference/exit-codes",
    "reference/process",
    "reference/sensor-file",
    "reference/glossary",
    "explanation/force-loop",
    "explanation/solvers",
    "explanation/uncertainty",
    "explanation/simulation",
    "explanation/verdicts",
    "explanation/promises",
    "explanation/validation",
    "explanation/minutes",
);

/// Prints a page, or the list of all.
pub(super) fn docs(args: &DocsArgs) -> Result<ExitCode, Failure> {
    match &args.page {
        Some(page) => print(&text_of(page)?)?,
        None => {
            let mut table = TextTable::new(2, ["page", "title"]);
            listed().for_each(|(name, title)| table.row([name, title]));
            let pages: Vec<_> = listed().map(|(name, title)| json!({ "page": name, "title": title })).collect();
            args.output.print(&table.to_string(), &json!({ "pages": pages }))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A page of the book: written by hand, or made by the program.
enum Page {
    Written(&'static str),
    Made(ReferencePage),
}

impl Page {
    fn by_name(name: &str) -> Option<Page> {
        let written = PAGES.iter().find(|(page, _)| *page == name).map(|(_, text)| Page::Written(text));
        let made = || ReferencePage::from_str(name.strip_prefix("reference/")?, false).ok().map(Page::Made);
        written.or_else(made)
    }

    fn text(self) -> String {
        match self {
            Page::Written(text) => text.to_owned(),
            Page::Made(page) => page.print(),
        }
    }
}

/// Returns name and title of each page that can be printed, in the order of the book.
fn listed() -> impl Iterator<Item = (&'static str, &'static str)> {
    let page = |line: &'static str| {
        let (title, file) = line.strip_prefix("- [")?.strip_suffix(".md)")?.split_once("](")?;
        Page::by_name(file).map(|_| (file, title))
    };
    INDEX.lines().filter_map(page)
}

fn text_of(page: &str) -> Result<String, Failure> {
    let name = page.strip_prefix("docs/").unwrap_or(page);
    let name = name.strip_suffix(".md").unwrap_or(name);
    if let Some(page) = Page::by_name(name) {
        return Ok(page.text());
    }
    let last = |name: &'static str| name.rsplit('/').next().unwrap_or(name);
    let alike: Vec<&str> = listed().map(|(known, _)| known).filter(|known| last(known) == name).collect();
    let (help, problem) = match alike.as_slice() {
        [one] => return Ok(Page::by_name(one).map(Page::text).unwrap_or_default()),
        [] => {
            let known: Vec<&str> = listed().flat_map(|(known, _)| [known, last(known)]).collect();
            let nearest = palpate_document::misspelt(name, &known);
            let nearest = nearest.map_or_else(String::new, |nearest| format!("did you mean {nearest}? "));
            (format!("{nearest}`palpate docs` lists the pages"), format!("the book has no page {page}"))
        }
        several => {
            (format!("write one of {}", several.join(", ")), format!("the book has {} pages {page}", several.len()))
        }
    };
    Err(Failure::usage(miette::miette!(help = help, "{problem}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_of_the_index_can_be_printed_except_those_for_developers() {
        let for_users = INDEX.split("# For developers").next().unwrap();
        let named = for_users.matches(".md)").count();
        assert_eq!(listed().count(), named - for_users.matches("](README.md)").count());
        assert_eq!(PAGES.len() + ReferencePage::value_variants().len(), listed().count());
    }

    #[test]
    fn pages_are_found_by_path_file_and_last_part() {
        let expected = Page::by_name("how-to/line-device").map(Page::text).unwrap();
        for page in ["how-to/line-device", "docs/how-to/line-device.md", "line-device", "line-device.md"] {
            assert_eq!(text_of(page).ok().unwrap(), expected, "{page}");
        }
        assert!(text_of("rig").ok().unwrap().starts_with("# "));
    }
}
