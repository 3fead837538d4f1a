//! `palpate list`: names the recipes, rigs and batches that come with the program, or prints one.

use super::output::OutputArgs;
use super::summary::{beside, print};
use crate::api::Failure;
use crate::api::protocols::PROTOCOLS;
use crate::api::shipped::{BATCHES, RECIPES, RIGS, Shipped, by_name};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate list
  palpate list rigs/esp301 > my-rig.toml
  palpate list protocols
  palpate check paper
  palpate run paper --rig bench-fast

Names work in any folder: paper, paper.toml and recipes/paper.toml are
the same recipe. If a file exists at that path, it is used instead.";

/// List the recipes, rigs and batches shipped with the program, or print one of them
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ListArgs {
    /// The file to print: rigs/esp301, recipes/bench, batches/batch; or protocols
    #[arg(value_name = "FOLDER/NAME")]
    file: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

/// The folders of all.
const FOLDERS: [(&str, &[Shipped]); 3] = [("recipes", RECIPES), ("rigs", RIGS), ("batches", BATCHES)];

/// Lists them, a paragraph each, or prints the text of one.
pub(super) fn list(args: &ListArgs) -> Result<ExitCode, Failure> {
    if args.file.as_deref() == Some(Path::new("protocols")) {
        return protocols(args.output);
    }
    if let Some(file) = &args.file {
        if args.output.json {
            let help = "palpate list --json, or palpate list protocols --json";
            return Err(Failure::usage(miette::miette!(help = help, "a file is printed as it is, not as JSON")));
        }
        print(text_of(file)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let text = format!(
        "recipes: palpate run NAME\n{}\nrigs: --rig NAME\n{}\nbatches: palpate batch run NAME\n{}",
        listed(RECIPES),
        listed(RIGS),
        listed(BATCHES)
    );
    let objects = |shipped: &[Shipped]| shipped.iter().map(Shipped::object).collect::<Vec<Value>>();
    let content = json!({ "recipes": objects(RECIPES), "rigs": objects(RIGS), "batches": objects(BATCHES) });
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Lists the published protocols that run: presses, source, and what differs.
fn protocols(output: OutputArgs) -> Result<ExitCode, Failure> {
    let (mut text, mut objects) = ("protocols: palpate init --from protocol:NAME\n".to_owned(), Vec::new());
    for protocol in PROTOCOLS {
        let (source, presses) = (protocol.source().map_err(Failure::usage)?, protocol.presses()?);
        let by = if protocol.has_load_cell() { "by force" } else { "by depth, no load cell" };
        let about = format!("{}; {presses} presses {by}; {}", source.source, source.runs());
        text += &beside(&format!("  {}", protocol.name), PROTOCOL_COLUMNS, &about);
        objects.push(json!({
            "name": protocol.name, "source": source.source, "url": source.url, "presses": presses,
            "is_whole": source.differs.is_empty(), "differs": source.differs, "lacks": source.lacks,
        }));
    }
    text += "\n`palpate reference protocols` lists what other published protocols lack.\n";
    output.print(&text, &json!({ "protocols": objects }))?;
    Ok(ExitCode::SUCCESS)
}

fn text_of(file: &Path) -> Result<&'static str, Failure> {
    let (folder, name) = (file.parent().and_then(Path::to_str), file.file_name().unwrap_or_default());
    let is_of = |of: &str| folder.is_none_or(|folder| folder.is_empty() || folder == of);
    let found = FOLDERS.into_iter().filter(|(of, _)| is_of(of));
    let found: Vec<(&str, &Shipped)> =
        found.filter_map(|(of, shipped)| Some((of, by_name(shipped, of, Path::new(name))?))).collect();
    match found.as_slice() {
        [(_, one)] => Ok(one.text),
        [] => {
            let help = "`palpate list` names all";
            Err(Failure::usage(miette::miette!(help = help, "{}: no file of this name is shipped", file.display())))
        }
        several => {
            let paths: Vec<String> = several.iter().map(|(of, one)| format!("{of}/{}", one.name)).collect();
            let help = format!("palpate list {}", paths[0]);
            Err(Failure::usage(miette::miette!(help = help, "{} is {}", file.display(), paths.join(" or "))))
        }
    }
}

fn listed(shipped: &[Shipped]) -> String {
    shipped.iter().map(|shipped| beside(&format!("  {}", shipped.name), COLUMNS, &shipped.about())).collect()
}

/// Column where the description of a file begins.
const COLUMNS: usize = 16;
const PROTOCOL_COLUMNS: usize = 25;

impl Shipped {
    fn object(&self) -> Value {
        json!({ "name": self.name, "about": self.about() })
    }

    /// Returns the first sentence of the file's first comment.
    fn about(&self) -> String {
        let comment = self.text.lines().map_while(|line| line.strip_prefix('#'));
        let text = comment.map(str::trim).collect::<Vec<_>>().join(" ");
        match text.split_once(". ") {
            Some((first, _)) => format!("{first}."),
            None => text,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_shipped_file_is_listed_with_its_description() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        for (folder, shipped) in FOLDERS {
            let entries = std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap());
            let files = entries.filter(|entry| entry.path().is_file()).map(|entry| entry.file_name());
            let files: BTreeSet<String> = files.map(|name| name.into_string().unwrap()).collect();
            assert_eq!(shipped.iter().map(|shipped| format!("{}.toml", shipped.name)).collect::<BTreeSet<_>>(), files);
            for shipped in shipped {
                let about = shipped.about();
                assert!(about.ends_with('.') && about.len() > 20, "{}: {about}", shipped.name);
            }
        }
    }

    #[test]
    fn a_shipped_file_is_printed_by_its_folder_and_name() {
        let text = |path: &str| text_of(Path::new(path)).map_err(|failure| failure.to_string());
        assert!(text("rigs/esp301").unwrap().contains("driver = \"esp301\""));
        assert_eq!(text("esp301.toml").unwrap(), text("rigs/esp301").unwrap());
        assert!(text("paper").unwrap_err().contains("paper is recipes/paper or rigs/paper"));
        assert!(text("rigs/none").unwrap_err().contains("no file of this name"));
    }
}
