//! `palpate schema` and `palpate reference`: the allowed content of recipes, rigs and other texts, for editors and for people.

use super::commands_page::commands_page;
use super::summary::print;
use crate::api::Failure;
use crate::api::protocols::published;
use clap::ValueEnum;
use clap::builder::PossibleValue;
use palpate_control::SafetyRule;
use palpate_data::dataset::COLUMN_KEYS;
use palpate_data::recipe;
use palpate_document::{Keys, reference, schema};
use palpate_drivers as driver;
use palpate_report::report::certificate::CERTIFICATE_KEYS;
use palpate_run::{batch, rig};
use std::process::ExitCode;

/// A kind of text that a person writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum TextKind {
    /// What to press, how, and how to evaluate it
    Recipe,
    /// The devices, the limits of the specimen and where it is
    Rig,
    /// Which sensors are calibrated, one after another
    Batch,
    /// The Modbus registers of a load cell or an array
    RegisterMap,
    /// The lines or frames that a load cell or an array sends
    LineProfile,
    /// An acceptance rule in a file of its own
    Acceptance,
    /// What the columns of your own tables hold
    Columns,
    /// What a certificate states and no run knows
    Certificate,
}

impl TextKind {
    /// Its name on the command line and in file names.
    pub(super) fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }

    /// Title of the schema and of the reference page.
    fn title(self) -> &'static str {
        match self {
            TextKind::Recipe => "Recipe",
            TextKind::Rig => "Rig",
            TextKind::Batch => "Batch",
            TextKind::RegisterMap => "Register map",
            TextKind::LineProfile => "Line profile",
            TextKind::Acceptance => "Acceptance rule",
            TextKind::Columns => "Columns file",
            TextKind::Certificate => "Certificate file",
        }
    }

    fn keys(self) -> Keys {
        match self {
            TextKind::Recipe => recipe::KEYS,
            TextKind::Rig => rig::KEYS,
            TextKind::Batch => batch::KEYS,
            TextKind::RegisterMap => driver::modbus::KEYS,
            TextKind::LineProfile => driver::lines::KEYS,
            TextKind::Acceptance => recipe::RULE_KEYS,
            TextKind::Columns => COLUMN_KEYS,
            TextKind::Certificate => CERTIFICATE_KEYS,
        }
    }

    /// Rules that the keys alone don't show.
    fn rules(self) -> &'static str {
        match self {
            TextKind::Recipe => include_str!("texts/recipe.md"),
            TextKind::Rig => include_str!("texts/rig.md"),
            TextKind::Batch => include_str!("texts/batch.md"),
            TextKind::RegisterMap => include_str!("texts/register-map.md"),
            TextKind::LineProfile => include_str!("texts/line-profile.md"),
            TextKind::Acceptance => include_str!("texts/acceptance.md"),
            TextKind::Columns => include_str!("texts/columns.md"),
            TextKind::Certificate => include_str!("texts/certificate.md"),
        }
    }

    /// Its JSON Schema.
    pub(super) fn schema(self) -> String {
        format!("{:#}\n", schema(&format!("palpate: {}", self.title().to_lowercase()), &self.keys()))
    }

    fn page(self) -> String {
        let begin = format!("# {}\n\n{}", self.title(), self.rules());
        reference(&begin, "The whole file", &self.keys())
    }
}

const SCHEMA_EXAMPLES: &str = "\
Example:
  palpate schema recipe > recipe.schema.json

An editor with a TOML plug-in checks a file that begins with
  #:schema recipe.schema.json
The program itself checks more: palpate check RECIPE --rig RIG.";

/// Print the JSON Schema of a recipe, a rig or another text, for editors
#[derive(Debug, clap::Args)]
#[command(after_help = SCHEMA_EXAMPLES)]
pub(super) struct SchemaArgs {
    /// Which text
    text: TextKind,
}

/// Prints the schema.
pub(super) fn print_schema(args: &SchemaArgs) -> Result<ExitCode, Failure> {
    print(&args.text.schema())?;
    Ok(ExitCode::SUCCESS)
}

/// Subject of a reference page: a kind of text file, the safety rules, the published protocols, or the commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReferencePage {
    Keys(TextKind),
    SafetyRules,
    Protocols,
    Commands,
}

impl ValueEnum for ReferencePage {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [ReferencePage; 11] = [
            ReferencePage::Keys(TextKind::Recipe),
            ReferencePage::Keys(TextKind::Rig),
            ReferencePage::Keys(TextKind::Batch),
            ReferencePage::Keys(TextKind::RegisterMap),
            ReferencePage::Keys(TextKind::LineProfile),
            ReferencePage::Keys(TextKind::Acceptance),
            ReferencePage::Keys(TextKind::Columns),
            ReferencePage::Keys(TextKind::Certificate),
            ReferencePage::SafetyRules,
            ReferencePage::Protocols,
            ReferencePage::Commands,
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            ReferencePage::Keys(text) => text.to_possible_value(),
            ReferencePage::SafetyRules => {
                Some(PossibleValue::new("safety-rules").help("What ends a run, and what to check"))
            }
            ReferencePage::Protocols => {
                Some(PossibleValue::new("protocols").help("Which published protocols run, and what the others lack"))
            }
            ReferencePage::Commands => Some(PossibleValue::new("commands").help("All commands and their options")),
        }
    }
}

impl ReferencePage {
    pub(super) fn print(self) -> String {
        match self {
            ReferencePage::Keys(text) => text.page(),
            ReferencePage::SafetyRules => safety_rules(),
            ReferencePage::Protocols => protocols_page(),
            ReferencePage::Commands => commands_page(),
        }
    }
}

const REFERENCE_EXAMPLES: &str = "\
Example:
  palpate reference rig | less";

/// Print a reference page as Markdown: every key with type, bounds, default and example, or every command
#[derive(Debug, clap::Args)]
#[command(after_help = REFERENCE_EXAMPLES)]
pub(super) struct ReferenceArgs {
    /// Which page
    page: ReferencePage,
}

/// Prints the page.
pub(super) fn print_reference(args: &ReferenceArgs) -> Result<ExitCode, Failure> {
    print(&args.page.print())?;
    Ok(ExitCode::SUCCESS)
}

/// Returns a page with the meaning of every safety rule, and what to check first.
fn safety_rules() -> String {
    let row = |rule: &SafetyRule| format!("| `{}` | {} | {} |\n", rule.name(), rule.meaning(), rule.check());
    let rows: String = SafetyRule::ALL.iter().map(row).collect();
    format!("{}| rule | meaning | first check |\n|---|---|---|\n{rows}", include_str!("texts/safety-rules.md"))
}

/// Returns a page with the published protocols, and what they lack.
fn protocols_page() -> String {
    let head = "| number | protocol | runs | lacks |\n|---|---|---|---|\n";
    format!("{}{head}{}", include_str!("texts/protocols.md"), published())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_on_its_page() {
        for text in TextKind::value_variants() {
            let page = text.page();
            for listed in text.keys().visit() {
                assert!(page.contains(&format!("\n| `{}` | ", listed.key.name)), "{}", listed.path);
            }
        }
    }
}
