//! `palpate init`: a recipe and a rig to begin with, and their schemas.

use super::summary::print;
use super::texts::TextKind;
use crate::api::Failure;
use crate::api::protocols::PROTOCOLS;
use crate::api::shipped::{RECIPES, RIGS, Shipped};
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser};
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::files;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate init my-sensor
  palpate init my-skin --from magnetic
  palpate init my-bench --from printer
  palpate init my-pad --from depth
  palpate init my-data --from tables
  palpate init strip --from protocol:fkeel-interdigitation";

/// Write a recipe and a rig to begin with, or a columns file, and their schemas for editors
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct InitArgs {
    /// Output folder; created if missing
    #[arg(value_name = "DIR", default_value = ".")]
    folder: PathBuf,

    /// Template: the sensor most like yours, tables, or the book's example
    #[arg(long, value_name = "START", default_value = "paper", value_parser = starts())]
    from: String,
}

/// Starting point of a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Start {
    /// 3 x 3 taxels under a soft cover, as in the paper, simulated
    Paper,
    /// 4 x 4 magnetometers with three axes, 5 mm apart
    Magnetic,
    /// 4 x 4 barometers
    Barometer,
    /// 4 x 4 sensors on a stage without a load cell, pressed by depth
    Depth,
    /// A 3D printer with Marlin as the stage, and an HX711 with a load cell
    Printer,
    /// Tables of presses that another program recorded
    Tables,
    /// The example files that the book uses
    Example,
}

/// Returns the parser of `--from`: the templates, and the published protocols.
fn starts() -> PossibleValuesParser {
    let templates = Start::value_variants().iter().filter_map(Start::to_possible_value);
    let protocols = PROTOCOLS.iter().map(|protocol| {
        PossibleValue::new(protocol.template).help(match protocol.has_load_cell() {
            true => "A published protocol, by force",
            false => "A published protocol, by depth without a load cell",
        })
    });
    PossibleValuesParser::new(templates.chain(protocols).collect::<Vec<_>>())
}

/// Returns the template of that name.
fn template(name: &str) -> Option<Template> {
    if let Some(protocol) = PROTOCOLS.iter().find(|protocol| protocol.template == name) {
        let mut template = bench(protocol.recipe.to_owned(), protocol.rig, protocol.name, " --simulate");
        template.next = template.next.replace("runs/liu-2018", "runs/paper"); // a run has the name of its recipe
        return Some(template);
    }
    Start::from_str(name, false).ok().map(Start::template)
}

/// Files that are written, and advice on their use.
struct Template {
    /// Each file's name and text.
    files: Vec<(String, String)>,
    /// Lines to type next.
    next: String,
}

impl Start {
    fn template(self) -> Template {
        let shipped =
            |all: &'static [Shipped], name| all.iter().find(|one| one.name == name).map_or("", |one| one.text);
        let skin = |name| include_str!("init/skin-recipe.toml").replace("SENSOR", name);
        match self {
            Start::Paper => bench(shipped(RECIPES, "paper").to_owned(), shipped(RIGS, "sim"), "paper", ""),
            Start::Magnetic => {
                bench(skin("magnetic"), include_str!("init/magnetic-rig.toml"), "magnetic", " --simulate")
            }
            Start::Barometer => {
                bench(skin("barometer"), include_str!("init/barometer-rig.toml"), "barometer", " --simulate")
            }
            Start::Depth => {
                let recipe = include_str!("init/depth-recipe.toml").to_owned();
                bench(recipe, include_str!("init/depth-rig.toml"), "depth", " --simulate")
            }
            Start::Printer => bench(
                include_str!("init/printer-recipe.toml").to_owned(),
                shipped(RIGS, "marlin"),
                "printer",
                " --simulate",
            ),
            Start::Example => Template {
                files: EXAMPLE.map(|(name, text)| (name.to_owned(), text.to_owned())).to_vec(),
                next: "  palpate run short.toml\n  \
                       palpate report runs/short --accept accept.toml\n  \
                       palpate evaluate calibration.csv test.csv\n"
                    .to_owned(),
            },
            Start::Tables => Template {
                files: with_schemas([(TextKind::Columns, include_str!("init/columns.toml")), CERTIFICATE]),
                next: "  palpate import ../grid.csv --test ../random.csv --columns columns.toml\n  \
                       palpate report runs/grid\n\n\
                       grid.csv and random.csv are your tables of calibration and test presses. Change\n\
                       columns.toml to their columns. `palpate reference columns` prints every key.\n"
                    .to_owned(),
            },
        }
    }
}

/// Returns a recipe and a rig. The run has the recipe's name. `simulate` is the option with which the rig runs without hardware.
fn bench(recipe: String, rig: &str, name: &str, simulate: &str) -> Template {
    let mut files = with_schemas([(TextKind::Recipe, recipe.as_str()), (TextKind::Rig, rig)]);
    // a certificate is about forces
    if !is_without_load_cell(rig) {
        files.extend(with_schemas([CERTIFICATE]));
    }
    Template {
        files,
        next: format!(
            "  palpate check recipe.toml{simulate}\n  \
             palpate run recipe.toml{simulate}\n  \
             palpate report runs/{name}\n\n\
             Change recipe and rig to your sensor and bench. `palpate reference recipe` and\n\
             `palpate reference rig` print every key.\n"
        ),
    }
}

fn is_without_load_cell(rig: &str) -> bool {
    rig.lines().any(|line| line.starts_with("load_cell = \"none\""))
}

const CERTIFICATE: (TextKind, &str) = (TextKind::Certificate, include_str!("init/certificate.toml"));

/// Example files: tables of presses, a short recipe with its rules, and a program for each role.
const EXAMPLE: [(&str, &str); 9] = [
    ("short.toml", include_str!("../../data/example/short.toml")),
    ("recipe.toml", include_str!("../../data/example/recipe.toml")),
    ("accept.toml", include_str!("../../data/example/accept.toml")),
    ("certificate.toml", include_str!("../../data/example/certificate.toml")),
    ("calibration.csv", include_str!("../../data/example/calibration.csv")),
    ("test.csv", include_str!("../../data/example/test.csv")),
    ("stage.py", include_str!("../../examples/stage.py")),
    ("load_cell.py", include_str!("../../examples/load_cell.py")),
    ("array.py", include_str!("../../examples/array.py")),
];

/// Returns text files under the names of their kinds, each with its schema.
fn with_schemas<const N: usize>(texts: [(TextKind, &str); N]) -> Vec<(String, String)> {
    let both = |(kind, text): (TextKind, &str)| {
        let name = kind.name();
        let schema = format!("{name}.schema.json");
        [(format!("{name}.toml"), format!("#:schema {schema}\n{text}")), (schema, kind.schema())]
    };
    texts.into_iter().flat_map(both).collect()
}

/// Writes the files, none of which may exist, and prints what to do next.
pub(super) fn init(args: &InitArgs) -> Result<ExitCode, Failure> {
    let Template { files, next } = template(&args.from).ok_or_else(|| {
        let help = "`palpate init --help` names the templates"; // the parser has refused other names
        Failure::usage(miette::miette!(help = help, "there is no template {}", args.from))
    })?;
    if let Some((file, _)) = files.iter().find(|(file, _)| args.folder.join(file).symlink_metadata().is_ok()) {
        let there = args.folder.join(file);
        let help = "name another folder: palpate init DIR";
        return Err(Failure::usage(miette::miette!(help = help, "{} exists already", there.display())));
    }
    for (file, text) in &files {
        write(&args.folder, file, text)?;
    }
    let folder = args.folder.display();
    let list: String = files.iter().map(|(file, _)| format!("  {file}\n")).collect();
    let enter = if args.folder == Path::new(".") { String::new() } else { format!("  cd {folder}\n") };
    print(&format!("written to {folder}:\n{list}\nnext:\n{enter}{next}"))?;
    Ok(ExitCode::SUCCESS)
}

fn write(folder: &Path, file: &str, text: &str) -> Result<(), Failure> {
    fs::create_dir_all(folder)
        .and_then(|()| files::place(&folder.join(file), text))
        .into_diagnostic()
        .wrap_err_with(|| format!("can't write {}", folder.join(file).display()))
        .map_err(Failure::unwritten)
}
