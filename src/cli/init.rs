//! `palpate init`: a recipe and a rig to begin with, and their schemas.

use super::exit::Failure;
use super::shipped::{RECIPES, RIGS, Shipped};
use super::summary::print;
use super::texts::Text;
use crate::dataset::files;
use clap::ValueEnum;
use miette::{IntoDiagnostic, WrapErr};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate init my-sensor
  palpate init my-skin --from magnetic";

/// Write a recipe and a rig to begin with, and their schemas for editors
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct InitArgs {
    /// The folder to write to; it is made if it is missing
    #[arg(value_name = "DIR", default_value = ".")]
    folder: PathBuf,

    /// The sensor that is nearest to yours
    #[arg(long, value_name = "SENSOR", default_value = "paper")]
    from: Sensor,
}

/// A sensor to begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Sensor {
    /// 3 x 3 taxels under a soft cover, as in the paper, simulated
    Paper,
    /// 4 x 4 magnetometers with three axes
    Magnetic,
    /// 4 x 4 barometers
    Barometer,
}

/// What is written of a sensor.
struct Template {
    recipe: String,
    rig: &'static str,
    /// The run's name in the recipe.
    name: &'static str,
    /// The option with which it runs without hardware; its links may be simulated already.
    simulate: &'static str,
}

impl Sensor {
    fn template(self) -> Template {
        let shipped =
            |all: &'static [Shipped], name| all.iter().find(|one| one.name == name).map_or("", |one| one.text);
        let skin = |name| include_str!("init/skin-recipe.toml").replace("SENSOR", name);
        match self {
            Sensor::Paper => Template {
                recipe: shipped(RECIPES, "paper").to_owned(),
                rig: shipped(RIGS, "sim"),
                name: "paper",
                simulate: "",
            },
            Sensor::Magnetic => Template {
                recipe: skin("magnetic"),
                rig: include_str!("init/magnetic-rig.toml"),
                name: "magnetic",
                simulate: " --simulate",
            },
            Sensor::Barometer => Template {
                recipe: skin("barometer"),
                rig: include_str!("init/barometer-rig.toml"),
                name: "barometer",
                simulate: " --simulate",
            },
        }
    }
}

/// Writes the files, none of which may exist, and prints what to do next.
pub fn init(args: &InitArgs) -> Result<ExitCode, Failure> {
    let Template { recipe, rig, name, simulate } = args.from.template();
    let with_schema = |schema: &str, text: &str| format!("#:schema {schema}\n{text}");
    let files = [
        ("recipe.toml", with_schema("recipe.schema.json", &recipe)),
        ("rig.toml", with_schema("rig.schema.json", rig)),
        ("recipe.schema.json", Text::Recipe.schema()),
        ("rig.schema.json", Text::Rig.schema()),
    ];
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
    print(&format!(
        "written to {folder}:\n{list}\nnext:\n{enter}  \
         palpate check recipe.toml --rig rig.toml{simulate}\n  \
         palpate run recipe.toml --rig rig.toml{simulate}\n  \
         palpate report runs/{name}\n\n\
         Change both files to your sensor and bench. `palpate reference recipe` and\n\
         `palpate reference rig` print every key.\n"
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn write(folder: &Path, file: &str, text: &str) -> Result<(), Failure> {
    fs::create_dir_all(folder)
        .and_then(|()| files::place(&folder.join(file), text))
        .into_diagnostic()
        .wrap_err_with(|| format!("can't write {}", folder.join(file).display()))
        .map_err(Failure::unwritten)
}
