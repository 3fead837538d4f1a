//! Recipes and rigs as a person names them.

use super::removed::with_remaining_methods;
use super::shipped::{self, RECIPES, RIGS, Shipped};
use super::stdin;
use super::which_rig::ChosenRig;
use super::{Failure, Note};
use palpate_control::Strategy;
use palpate_data::dataset::{Origins, Texts};
use palpate_data::recipe::{self, Accept, PRESSES_CEILING, Plan, Recipe};
use palpate_document::TEXT_MAX_BYTES;
use palpate_run::rig::{self, OwnFile, RigSpec};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// A recipe and a rig, read and understood, with their texts.
pub(crate) struct Sources {
    /// The recipe.
    pub recipe: Recipe,
    /// The rig.
    pub rig: RigSpec,
    /// How the rig was chosen.
    pub chosen: ChosenRig,
    /// Both as given.
    pub origins: Origins,
}

/// The rig of a recipe, and options that replace the recipe's own values.
#[derive(Clone, Debug, clap::Args)]
pub struct RigOptions {
    /// The rig to use [default: the recipe's `rig`, or rig.toml in its folder; the simulated rig for a shipped recipe]
    #[arg(long, value_name = "RIG")]
    pub rig: Option<PathBuf>,
    /// Simulate: replace the rig's links by emulators, in virtual time
    #[arg(long)]
    pub simulate: bool,
    /// Random seed for places, forces and simulated noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Strategy for all presses, instead of the recipe's: guarded, velocity or map
    #[arg(long, value_name = "NAME", value_parser = strategy)]
    pub strategy: Option<Strategy>,
    /// Largest number of presses in a plan
    #[arg(long, value_name = "N", value_parser = presses_max)]
    pub presses_max: Option<usize>,
}

impl Default for RigOptions {
    fn default() -> Self {
        RigOptions { rig: None, simulate: false, seed: 1, strategy: None, presses_max: None }
    }
}

impl RigOptions {
    /// Checks what the types of the options allow but a plan doesn't.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let Some(most) = self.presses_max else { return Ok(()) };
        presses_max(&most.to_string()).map(drop).map_err(|why| Failure::option("--presses-max", most, &why))
    }
}

impl Sources {
    /// Reads a recipe from its file, chooses its rig and reads it.
    pub(crate) fn read(path: &Path, rig: &RigOptions) -> Result<Sources, Failure> {
        let text = read_named(path, RECIPES, "recipes")?;
        let beside = |name: &str| bounded(&path.with_file_name(name));
        let recipe = parse_recipe(path, text.clone(), &beside);
        // without --rig, only a correct recipe has a rig
        let recipe = if rig.rig.is_some() { recipe } else { Ok(recipe?) };
        let key = recipe.as_ref().ok().and_then(|read| read.recipe.rig.clone());
        let chosen = ChosenRig::of(path, &text, key.as_deref(), rig.rig.as_deref());
        let sources = Sources::of(recipe, chosen.and_then(|chosen| Ok((chosen.read()?, chosen))), rig)?;
        match rig.strategy.filter(|_| !sources.rig.has_load_cell()) {
            Some(strategy) => Err(Failure::option(
                "--strategy",
                strategy.name(),
                "a rig without a load cell has no strategy: remove it",
            )),
            None => Ok(sources),
        }
    }

    /// A run's recipe, as its journal keeps it, on a rig of that text. Register maps are those of the journal too.
    pub(crate) fn of_run(
        run: &Path,
        texts: &Texts,
        rig: &RigOptions,
        chosen: ChosenRig,
        note: Note<'_>,
    ) -> Result<Sources, Failure> {
        let recipe = parse_kept_recipe(run, texts, note);
        let began = parse_rig(&run.join("rig.toml"), texts.first_rig(), texts)?;
        let full_scale_n = Some(began.limits.force_n);
        let spec = parse_rig(&chosen.path, &chosen.text, texts);
        Sources::of(recipe, spec.map(|spec| (RigSpec { full_scale_n, ..spec }, chosen)), rig)
    }

    fn of(
        recipe: Result<ReadRecipe, Failure>,
        spec: Result<(RigSpec, ChosenRig), Failure>,
        rig: &RigOptions,
    ) -> Result<Sources, Failure> {
        let (ReadRecipe { recipe, text: recipe_text, rule }, (spec, chosen)) = match (recipe, spec) {
            (Ok(recipe), Ok(spec)) => (recipe, spec),
            (Err(failure), Ok(_)) | (Ok(_), Err(failure)) => return Err(failure),
            (Err(recipe), Err(rig)) => return Err(rig.after(recipe)), // both are reported at once
        };
        let recipe = match rig.strategy {
            Some(strategy) => recipe.with_strategy(strategy),
            None => recipe,
        };
        let recipe = match rig.presses_max {
            Some(presses_max) => recipe.with_presses_max(presses_max),
            None => recipe,
        };
        let spec = as_asked(spec, rig.simulate, rig.seed)?;
        let beside = own_texts(&spec).into_iter().chain(rule).collect();
        let origins = Origins::new(recipe_text, chosen.text.clone(), beside);
        Ok(Sources { recipe, rig: spec, chosen, origins })
    }

    /// The plan, limits of the rig.
    pub(crate) fn plan(&self, seed: u64) -> Result<Plan, Failure> {
        Plan::new(&self.recipe, &self.rig.ground(), seed).map_err(Failure::usage)
    }
}

/// A recipe as it was read.
pub(crate) struct ReadRecipe {
    /// The recipe, with its acceptance rule.
    pub recipe: Recipe,
    /// Its text.
    pub text: String,
    /// The acceptance file that it names: name and text.
    pub rule: Option<(String, String)>,
}

/// Parses a recipe's text together with the acceptance file that it names. `beside` returns the text of a file in the recipe's
/// folder.
pub(crate) fn parse_recipe(
    path: &Path,
    text: String,
    beside: &dyn Fn(&str) -> io::Result<String>,
) -> Result<ReadRecipe, Failure> {
    let recipe = recipe::parse(&path.display().to_string(), &text).map_err(Failure::usage)?;
    let Some(Accept::File(name)) = recipe.accept.clone() else { return Ok(ReadRecipe { recipe, text, rule: None }) };
    let file = path.with_file_name(&name).display().to_string();
    let rule_text = beside(&name).map_err(|why| {
        let why = match why.kind() {
            io::ErrorKind::NotFound => "which isn't in the recipe's folder".to_owned(),
            _ => format!("which can't be read: {why}"),
        };
        let help = "correct the name, or put the file into the recipe's folder";
        Failure::usage(miette::miette!(help = help, "{}: `accept` names {file}, {why}", path.display()))
    })?;
    let rule = recipe::parse_rule(&file, &rule_text).map_err(Failure::usage)?;
    Ok(ReadRecipe { recipe: recipe.with_rule(rule, &file, &rule_text), text, rule: Some((name, rule_text)) })
}

/// The recipe of a run, as its journal keeps it.
pub(crate) fn parse_kept_recipe(run: &Path, texts: &Texts, note: Note<'_>) -> Result<ReadRecipe, Failure> {
    let text = with_remaining_methods(&run.display().to_string(), texts.recipe(), note);
    parse_recipe(&run.join("recipe.toml"), text, &kept(texts))
}

/// Returns the text files stored in a run's journal, found by their names.
fn kept(texts: &Texts) -> impl Fn(&str) -> io::Result<String> {
    |name| texts.latest(name).map(str::to_owned).ok_or_else(|| io::ErrorKind::NotFound.into())
}

/// Returns a rig with emulators if requested. A rig that can't be simulated is reported before anything is created.
pub(crate) fn as_asked(spec: RigSpec, simulate: bool, seed: u64) -> Result<RigSpec, Failure> {
    let spec = if simulate { spec.simulated() } else { spec };
    if spec.is_simulated() {
        spec.emulators(seed).map_err(Failure::usage)?;
    }
    Ok(spec)
}

/// The text of a rig: of a file, or of a shipped one of that name.
pub(crate) fn read_rig_text(path: &Path) -> Result<String, Failure> {
    read_named(path, RIGS, "rigs")
}

/// Returns a rig's text and its content.
pub(crate) fn read_rig(path: &Path) -> Result<(String, RigSpec), Failure> {
    let text = read_rig_text(path)?;
    let beside = |name: &str| bounded(&path.with_file_name(name));
    let spec = rig::parse(&path.display().to_string(), &text, &beside).map_err(Failure::usage)?;
    Ok((text, spec))
}

/// A rig's text understood, its register maps and line profiles being those that a run's journal keeps.
pub(crate) fn parse_rig(path: &Path, text: &str, texts: &Texts) -> Result<RigSpec, Failure> {
    rig::parse(&path.display().to_string(), text, &kept(texts)).map_err(Failure::usage)
}

/// A file that a person wrote, as text.
pub(crate) fn read(path: &Path) -> Result<String, Failure> {
    bounded(path).map_err(|error| unread(path, &error, "give an existing file"))
}

/// Reads a text file at a path, or a shipped file of that name. A file at the path has priority.
fn read_named(path: &Path, shipped: &[Shipped], folder: &str) -> Result<String, Failure> {
    if let Some(shipped) = shipped::named(shipped, folder, path) {
        return Ok(shipped.text.to_owned());
    }
    let inside = path.join(folder.trim_end_matches('s')).with_extension("toml");
    let help = || match (inside.is_file(), shipped::nearest(shipped, path)) {
        (true, _) => format!("did you mean {}?", inside.display()),
        (false, nearest) => {
            let nearest = nearest.map(|nearest| format!("did you mean {nearest}? Or ")).unwrap_or_default();
            format!("{nearest}give an existing file or a shipped one: {}", shipped::names(shipped).join(", "))
        }
    };
    bounded(path).map_err(|error| unread(path, &error, &help()))
}

/// Reads a text that another file names: a file relative to that file, or a shipped one. A file has priority. `what` names it.
pub(crate) fn read_named_in(
    file: &Path,
    name: &str,
    shipped: &[Shipped],
    folder: &str,
    what: &str,
) -> Result<(PathBuf, String), Failure> {
    let path = file.parent().unwrap_or(Path::new("")).join(name);
    let is_there = path.symlink_metadata().is_ok_and(|found| !found.is_dir());
    // a path is never a shipped file: the same text would mean another file from another folder
    let is_name = !name.contains(['/', '\\']);
    if let Some(shipped) = shipped::by_name(shipped, folder, Path::new(name)).filter(|_| is_name && !is_there) {
        return Ok((PathBuf::from(format!("{}.toml", shipped.name)), shipped.text.to_owned()));
    }
    let help =
        || format!("{what} names it; give an existing file or a shipped one: {}", shipped::names(shipped).join(", "));
    let text = bounded(&path).map_err(|error| unread(&path, &error, &help()))?;
    Ok((path, text))
}

/// A text file that couldn't be read.
pub(crate) fn unread(path: &Path, error: &io::Error, help: &str) -> Failure {
    let help = match error.kind() {
        io::ErrorKind::InvalidData if is_utf16(path) => "it is UTF-16: save it as UTF-8",
        io::ErrorKind::InvalidData => match not_utf8(path) {
            Some(line) => {
                let help = "save it as UTF-8";
                return Failure::usage(miette::miette!(help = help, "{}:{line}: a letter isn't UTF-8", path.display()));
            }
            None => "give a TOML file: this file isn't text",
        },
        _ => help,
    };
    Failure::usage(miette::miette!(help = help, "{}: {error}", path.display()))
}

/// Returns the line of the first byte that isn't UTF-8; `None` if the file isn't text at all.
fn not_utf8(path: &Path) -> Option<usize> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(TEXT_MAX_BYTES as u64).read_to_end(&mut bytes).ok()?;
    let is_text = bytes.iter().all(|byte| *byte >= b' ' || byte.is_ascii_whitespace());
    let valid = std::str::from_utf8(&bytes).err()?.valid_up_to();
    is_text.then(|| 1 + bytes[..valid].iter().filter(|byte| **byte == b'\n').count())
}

/// Whether a file begins with the byte-order mark of UTF-16, as some Windows editors write it.
fn is_utf16(path: &Path) -> bool {
    let mut mark = [0; 2];
    let is_read = File::open(path).and_then(|mut file| file.read_exact(&mut mark)).is_ok();
    is_read && matches!(mark, [0xFF, 0xFE] | [0xFE, 0xFF])
}

/// Reads a text file of at most the length that a recipe or a rig may have; `-` is standard input.
pub(crate) fn bounded(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    stdin::open(path)?.take(TEXT_MAX_BYTES as u64 + 1).read_to_string(&mut text)?;
    Ok(text)
}

/// Reads the name of a strategy.
pub(crate) fn strategy(name: &str) -> Result<Strategy, String> {
    let names = || Strategy::ALL.map(Strategy::name).join(", ");
    let named = Strategy::ALL.into_iter().find(|strategy| strategy.name() == name);
    named.ok_or_else(|| format!("expected one of {}", names()))
}

/// Reads a random seed.
pub(crate) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected a whole number, 0 to {}", u64::MAX))
}

/// Reads a pace.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace.is_finite() && pace > 0.0 => Ok(pace),
        _ => Err("expected a number above 0: 1 is real time, 60 is one minute per second".to_owned()),
    }
}

fn presses_max(text: &str) -> Result<usize, String> {
    let within = |most: &usize| (1..=PRESSES_CEILING).contains(most);
    text.parse().ok().filter(within).ok_or_else(|| format!("expected a whole number, 1 to {PRESSES_CEILING}"))
}

/// Returns the texts that a rig's drivers read from the rig's folder: register maps and line profiles, by name.
pub(crate) fn own_texts(spec: &RigSpec) -> BTreeMap<String, String> {
    let monitors = spec.monitors.iter().map(|monitor| monitor.array.driver.own_file());
    let roles = [spec.load_cell.driver.own_file(), spec.array.driver.own_file()];
    let files = roles.into_iter().chain(monitors);
    files.into_iter().flatten().filter_map(own_file).collect()
}

fn own_file(file: &OwnFile) -> Option<(String, String)> {
    file.text.as_ref().map(|text| (file.name.clone(), text.clone()))
}
