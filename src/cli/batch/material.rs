//! The files of a batch, read and understood.

use super::super::exit;
use super::super::summary::note;
use crate::api::Failure;
use crate::api::recorded::read_run;
use crate::api::shipped::{self, BATCHES, RECIPES};
use crate::api::sources::{ReadRecipe, as_asked, bounded, own_texts, parse_recipe, read_named_in, unread};
use crate::api::which_rig::{ChosenRig, THE_BATCH};
use palpate_core::quantity::{Place, round};
use palpate_data::acceptance::AcceptanceRule;
use palpate_data::dataset::calibration::calibration_of_run;
use palpate_data::dataset::{Fingerprint, Origins, RecordedText, source_fingerprint};
use palpate_data::recipe::{self, Phase, Plan};
use palpate_run::batch::{self, BatchFile, Charted, Nest, PriorRuns, Quantity, RIG};
use palpate_run::rig::{self, RigSpec};
use palpate_solver::{ForceKnown, Prior};
use std::collections::{BTreeMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use toml_edit::{DocumentMut, InlineTable, Value, value};

/// Names under which a batch folder keeps the texts.
pub(super) const BATCH: &str = "batch.toml";
const ACCEPT: &str = "accept.toml";

/// Digits of an origin after the decimal point, mm.
const ORIGIN_DIGITS: i32 = 6;

/// The files of a batch.
pub(super) struct Material {
    /// The batch file.
    pub file: BatchFile,
    /// The rig, simulated if requested.
    pub rig: RigSpec,
    /// Name of the bench.
    pub bench: String,
    /// The recipes.
    pub recipes: Vec<ReadRecipe>,
    /// The acceptance rule.
    pub rule: Option<AcceptanceRule>,
    /// The design's prior.
    pub prior: Option<Prior>,
    /// Journals of the runs that make the prior.
    pub made_from: Vec<Fingerprint>,
    /// All texts, as the batch folder keeps them.
    pub texts: Vec<RecordedText>,
    /// How the rig was chosen.
    pub chosen: ChosenRig,
    simulate: bool,
}

/// A rig at one nest.
pub(super) struct NestRig {
    /// The rig, whose specimen is in the nest.
    pub spec: RigSpec,
    /// Its text.
    pub text: String,
}

impl Material {
    /// Reads a batch file, and the files that it names.
    pub(super) fn read(path: &Path, simulate: bool) -> Result<Material, Failure> {
        let text = match shipped::named(BATCHES, "batches", path) {
            Some(shipped) => shipped.text.to_owned(),
            None => bounded(path).map_err(|error| {
                unread(
                    path,
                    &error,
                    &format!("give an existing file or a shipped one: {}", shipped::names(BATCHES).join(", ")),
                )
            })?,
        };
        let file = batch::parse(&path.display().to_string(), &text).map_err(Failure::usage)?;
        let mut texts = vec![RecordedText { name: BATCH.to_owned(), text }];
        let rig = read_rig(path, &file.rig, simulate);
        let named = rig.as_ref().ok().map(|(chosen, _)| chosen);
        let recipes: Vec<Result<ReadRecipe, Failure>> =
            file.recipes.iter().map(|recipe| read_recipe(path, recipe, named)).collect();
        let accept = file.accept.as_ref().map(|accept| read_rule(path, accept)).transpose();
        let prior = file.prior.as_ref().map(|prior| read_prior(path, prior)).transpose();
        // all are reported at once
        let (mut read, mut failures) = (Vec::new(), Vec::new());
        recipes.into_iter().for_each(|recipe| recipe.map_or_else(|why| failures.push(why), |recipe| read.push(recipe)));
        let rig = rig.map_err(|why| failures.push(why)).ok();
        let accept = accept.map_err(|why| failures.push(why)).ok();
        let prior = prior.map_err(|why| failures.push(why)).ok();
        let last = failures.pop();
        failures.into_iter().for_each(|failure| _ = exit::report(failure));
        let ((chosen, rig), accept, prior) = match (last, rig, accept, prior) {
            (Some(last), ..) => return Err(last),
            (None, Some(rig), Some(accept), Some(prior)) => (rig, accept, prior),
            _ => unreachable!("what couldn't be read is a failure"),
        };
        let mut keep = |name: String, text: &str| texts.push(RecordedText { name, text: text.to_owned() });
        keep(RIG.to_owned(), &chosen.text);
        own_texts(&rig).iter().for_each(|(name, text)| keep(format!("rig-{name}"), text));
        for (number, recipe) in (1..).zip(&read) {
            keep(format!("recipe-{number}.toml"), &recipe.text);
            recipe.rule.iter().for_each(|(name, text)| keep(format!("recipe-{number}-{name}"), text));
        }
        accept.iter().for_each(|(_, text)| keep(ACCEPT.to_owned(), text));
        let rule = accept.map(|(rule, _)| rule).or_else(|| read.first().and_then(|first| first.recipe.rule().cloned()));
        let stem = chosen.path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let bench = file.bench.clone().or(stem).unwrap_or_default();
        let (prior, made_from) = prior.map_or((None, Vec::new()), |(prior, made_from)| (Some(prior), made_from));
        let outputs = rig.array.layout.len();
        if let Some(prior) = prior.as_ref().filter(|prior| prior.outputs() != outputs) {
            let problem =
                format!("the rig's array has {outputs} outputs, the sensors of the prior {}", prior.outputs());
            return Err(no_prior(path, &problem, "name the rig and the full calibrations of one design"));
        }
        Ok(Material { file, rig, bench, recipes: read, rule, prior, made_from, texts, chosen, simulate })
    }

    /// Returns the rig with its frame moved to a nest; unchanged without a nest.
    pub(super) fn rig_at(&self, nest: Option<&Nest>) -> Result<NestRig, Failure> {
        let Some(nest) = nest else { return Ok(NestRig { spec: self.rig.clone(), text: self.chosen.text.clone() }) };
        let moved = moved(&self.chosen.text, &self.rig, nest);
        let text = moved.map_err(|error| Failure::usage(miette::miette!("{}: {error}", self.chosen.path.display())))?;
        let own = own_texts(&self.rig);
        let beside = |name: &str| own.get(name).cloned().ok_or_else(|| io::ErrorKind::NotFound.into());
        let name = format!("{} at the nest {}", self.chosen.path.display(), nest.name);
        let spec = rig::parse(&name, &text, &beside).map_err(Failure::usage)?;
        Ok(NestRig { spec: as_asked(spec, self.simulate, self.file.seed)?, text })
    }

    /// Returns the plan of a recipe on a rig; an error if it leaves the rig's travel or limits.
    pub(super) fn plan(&self, recipe: usize, spec: &RigSpec, seed: u64) -> Result<Plan, Failure> {
        Plan::new(&self.recipes[recipe].recipe, &spec.ground(), seed).map_err(Failure::usage)
    }

    /// Returns the command that is notified of events: that of the batch file, or else that of the rig.
    pub(super) fn notified(&self) -> &[String] {
        if self.file.notify.is_empty() { &self.rig.notify } else { &self.file.notify }
    }

    /// Returns the normal values of the quantities that are charted; none without a prior.
    pub(super) fn charted(&self) -> Result<Vec<Charted>, Failure> {
        let Some(prior) = &self.prior else { return Ok(Vec::new()) };
        let plan = self.plan(0, &self.rig, self.file.seed)?;
        let (places, press_n) = calibrated(&plan);
        let (spread, repeats) = (prior.spread_of_means(), prior.repeats_of_means(&places, press_n));
        let of = |quantity: Quantity| {
            let [mean, sd, reference_sd] = match quantity {
                Quantity::Gain => [1.0, spread.gain, repeats.gain],
                Quantity::Width => [0.0, spread.width, repeats.width],
            };
            Charted { quantity: quantity.name().to_owned(), mean, sd, reference_sd, sensors: prior.sensors() }
        };
        Ok(Quantity::ALL.map(of).to_vec())
    }

    /// Checks every recipe at every nest.
    pub(super) fn check(&self) -> Result<(), Failure> {
        for nest in self.nests() {
            let rig = self.rig_at(nest)?;
            for recipe in 0..self.recipes.len() {
                let plan = self.plan(recipe, &rig.spec, self.file.seed);
                if let (Err(_), Some(nest)) = (&plan, nest) {
                    super::super::summary::tell(&format!("at the nest {}:\n", nest.name))?;
                }
                plan?;
            }
        }
        Ok(())
    }

    /// Returns the nests of the tray; a single `None` without a tray.
    pub(super) fn nests(&self) -> impl Iterator<Item = Option<&Nest>> {
        self.file.nests.iter().map(Some).chain(self.file.nests.is_empty().then_some(None))
    }

    /// Returns the texts of a run of a recipe on a rig.
    pub(super) fn origins(&self, recipe: usize, rig: &NestRig) -> Origins {
        let ReadRecipe { text, rule, .. } = &self.recipes[recipe];
        let beside: BTreeMap<String, String> = own_texts(&rig.spec).into_iter().chain(rule.clone()).collect();
        Origins::new(text.clone(), rig.text.clone(), beside.into_iter().collect())
    }
}

/// Returns the rig's text with the origin of its frame moved by a nest's offset.
fn moved(text: &str, rig: &RigSpec, nest: &Nest) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    let origin = rig.frame.origin;
    let mut table = InlineTable::new();
    for (key, mm) in [("x", origin.x_mm + nest.offset.x_mm), ("y", origin.y_mm + nest.offset.y_mm)] {
        table.insert(key, Value::from(round(mm, ORIGIN_DIGITS)));
    }
    table.fmt();
    document["frame"]["origin_mm"] = value(table);
    Ok(document.to_string())
}

/// Returns a path that a batch file names, relative to the batch file.
fn path_of(batch: &Path, name: &str) -> PathBuf {
    batch.parent().unwrap_or(Path::new("")).join(name)
}

fn read_rig(batch: &Path, name: &str, simulate: bool) -> Result<(ChosenRig, RigSpec), Failure> {
    let chosen = ChosenRig::of_batch(batch, name)?;
    let spec = as_asked(chosen.read()?, simulate, 1)?;
    Ok((chosen, spec))
}

/// Reads a recipe. `rig` is the one of the batch, if it could be read.
fn read_recipe(batch: &Path, name: &str, rig: Option<&ChosenRig>) -> Result<ReadRecipe, Failure> {
    let (path, text) = read_named_in(batch, name, RECIPES, "recipes", THE_BATCH)?;
    let read = parse_recipe(&path, text, &|name: &str| bounded(&path.with_file_name(name)))?;
    if let (Some(rig), Some(key)) = (rig, &read.recipe.rig) {
        rig.check_same(&path, key)?;
    }
    Ok(read)
}

fn read_rule(batch: &Path, name: &str) -> Result<(AcceptanceRule, String), Failure> {
    let path = path_of(batch, name);
    let text =
        bounded(&path).map_err(|error| unread(&path, &error, "the batch names it in `accept`; correct the name"))?;
    let rule = recipe::parse_rule(&path.display().to_string(), &text).map_err(Failure::usage)?;
    Ok((rule, text))
}

/// Returns the places of a plan's calibration, and its largest force, N.
pub(super) fn calibrated(plan: &Plan) -> (Vec<Place>, f64) {
    let calibration = || plan.entries.iter().filter(|entry| entry.phase == Phase::Calibration);
    let press_n = calibration().map(|entry| entry.task.most_n()).fold(0.0, f64::max);
    (calibration().map(|entry| entry.place).collect(), press_n)
}

/// Makes the prior from the run folders that a batch file names. Returns it with the fingerprints of their journals.
fn read_prior(batch: &Path, named: &PriorRuns) -> Result<(Prior, Vec<Fingerprint>), Failure> {
    let (mut calibrations, mut made_from, mut layout) = (Vec::new(), Vec::new(), None);
    let mut sensors = HashSet::new();
    for name in &named.runs {
        let path = path_of(batch, name);
        if !path.is_dir() {
            let help = "a path in a batch file is relative to the batch file";
            let problem = format!("`prior.runs` names {name}, but {} is not a folder", path.display());
            return Err(no_prior(batch, &problem, help));
        }
        let (run, bench) = read_run(&path, &note)?;
        let presses = run.presses();
        let journal = source_fingerprint(&path).map_err(Failure::dataset)?;
        let sensor = run.manifest.facts.labels.sensor;
        let is_again = made_from.iter().any(|made: &Fingerprint| made.sha256 == journal.sha256);
        if is_again || sensor.as_ref().is_some_and(|sensor| sensors.contains(sensor)) {
            let problem = format!("`prior.runs` names the sensor of {name} twice");
            return Err(no_prior(batch, &problem, "name one run folder for each sensor"));
        }
        sensors.extend(sensor);
        calibrations.push(calibration_of_run(&presses, ForceKnown::default()).map_err(Failure::usage)?);
        made_from.push(journal);
        layout = layout.or_else(|| bench.placed().cloned());
    }
    let help = "`prior.runs` names run folders of full calibrations of different sensors of one design";
    let prior = Prior::new(&calibrations, layout.as_ref()).map_err(|why| no_prior(batch, &why.to_string(), help))?;
    Ok((prior, made_from))
}

fn no_prior(batch: &Path, problem: &str, help: &str) -> Failure {
    Failure::usage(miette::miette!(help = help.to_owned(), "{}: no prior: {problem}", batch.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_batch_is_read_with_all_its_files() {
        let material = Material::read(Path::new("batches/batch.toml"), false).expect("the shipped batch");
        material.check().expect("it fits its rig");
        let names: Vec<&str> = material.texts.iter().map(|text| text.name.as_str()).collect();
        assert_eq!(names, ["batch.toml", "rig.toml", "recipe-1.toml"]);
        assert_eq!(material.bench, "batch");
        assert!(material.rule.is_some());
    }

    #[test]
    fn a_nest_moves_the_origin_and_a_plan_out_of_the_travel_is_refused_before_anything_moves() {
        let mut material = Material::read(Path::new("batches/batch.toml"), false).expect("the shipped batch");
        let nest = |x_mm| Nest { name: "right".to_owned(), offset: Place::new(x_mm, -1.0) };
        let rig = material.rig_at(Some(&nest(2.5))).expect("a rig");
        assert_eq!(rig.spec.frame.origin, Place::new(2.5, -1.0));
        assert!(rig.text.contains("origin_mm = { x = 2.5, y = -1.0 }"), "{}", rig.text);
        material.file.nests = vec![nest(2.5), nest(7.0)];
        assert!(material.check().is_err());
        material.file.nests.pop();
        material.check().expect("within the travel");
    }
}
