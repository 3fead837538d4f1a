//! The method that is asked for, and what it is fitted to: a run or a table.

use super::choices::{QuantityChoice, quantity};
use super::columns::ColumnsOptions;
use super::recorded::{read_presses, read_run};
use super::{Failure, Note, stdin};
use clap::builder::PossibleValuesParser;
use miette::{IntoDiagnostic, WrapErr};
use palpate_core::quantity::ArrayLayout;
use palpate_data::dataset::calibration::{check_places, run_by, table_by};
use palpate_data::dataset::sensor_file::{is_sensor_file, read_sensor_file};
use palpate_data::dataset::{Fingerprint, Manifest, Mapping, Status};
use palpate_data::recipe::Phase;
use palpate_solver::{BEST, Calibration, ForceKnown, Model, SOLVERS, Setting};
use std::path::{Path, PathBuf};

/// Every name a method can be asked for by, with some more.
pub(crate) fn solvers<const MORE: usize>(more: [&'static str; MORE]) -> PossibleValuesParser {
    PossibleValuesParser::new(more.into_iter().chain(SOLVERS))
}

/// Checks that a method can be asked for by this name: one of all methods, or one of some more.
pub(crate) fn check_solver(name: &str, more: &[&str]) -> Result<(), Failure> {
    let names = [more, &SOLVERS].concat();
    if names.contains(&name) {
        return Ok(());
    }
    let nearest =
        palpate_document::misspelt(name, &names).map_or(String::new(), |near| format!("; did you mean {near}?"));
    Err(Failure::option("--solver", name, &format!("expected one of {}{nearest}", names.join(", "))))
}

/// Knowledge of the forces, by `--constant-load`.
pub(crate) fn load(is_constant: bool) -> ForceKnown {
    if is_constant { ForceKnown::Constant } else { ForceKnown::Unknown }
}

/// The method, and what contacts to expect.
#[derive(Clone, Debug, clap::Args)]
pub struct MethodOptions {
    /// The method; best selects by cross-validation on the calibration
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST]))]
    pub solver: String,
    /// Assume that every contact has the force of the calibration
    #[arg(long)]
    pub constant_load: bool,
    /// What to solve besides the place [default: force, or depth if only depths are known]
    #[arg(long, value_name = "QUANTITY", value_enum)]
    pub quantity: Option<QuantityChoice>,
    /// Also solve for an offset that is the same for all outputs
    #[arg(long)]
    pub common_offset: bool,
    /// Accepted share of single contacts with a wrong verdict
    #[arg(long, value_name = "SHARE", default_value_t = Setting::default().false_alarms, value_parser = share)]
    pub false_alarms: f64,
    /// Expected forces, N, if the calibration has one force [default: from a tenth of that force to that force]
    #[arg(long, num_args = 2, value_names = ["MIN", "MAX"], value_parser = force, conflicts_with = "constant_load")]
    pub forces_n: Vec<f64>,
    /// Solve force vectors or two contacts, from presses and drags
    #[arg(long, conflicts_with_all = ["solver", "constant_load", "quantity", "common_offset", "forces_n"])]
    pub vector: bool,
    /// Solve the force of a series of readings with times
    #[arg(long, conflicts_with_all = ["solver", "constant_load", "quantity", "common_offset", "false_alarms", "forces_n", "vector"])]
    pub history: bool,
    /// Meaning of the columns of tables.
    #[command(flatten)]
    pub columns: ColumnsOptions,
}

/// What a method is fitted to.
pub(crate) struct FitSource {
    /// The run folder or the table.
    pub path: PathBuf,
    /// Its presses.
    pub calibration: Calibration,
    /// Where the units are, where that is known.
    pub layout: Option<ArrayLayout>,
    /// The sensor's ID, where the run has one.
    pub sensor: Option<String>,
    /// Its forces are relative, not in newtons.
    pub is_relative: bool,
}

impl FitSource {
    /// Reads a run folder or a table of presses.
    pub(crate) fn read(path: &Path, method: &MethodOptions, note: Note<'_>) -> Result<FitSource, Failure> {
        let load = method.load();
        let path = path.to_owned();
        if path.is_dir() {
            let (recorded, bench) = read_run(&path, note)?;
            let Manifest { status, presses_done, facts, .. } = &recorded.manifest;
            if *status != Status::Complete {
                let (name, status, planned) = (path.display(), status.name(), facts.presses_planned);
                note(&format!("note: {name} is {status}: {presses_done} of {planned} presses"));
            }
            let calibration = run_by(&recorded.presses(), load, quantity(method.quantity)).map_err(Failure::usage)?;
            let (layout, sensor) = (bench.placed().cloned(), recorded.manifest.facts.labels.sensor.clone());
            return Ok(FitSource { path, calibration, layout, sensor, is_relative: false });
        }
        let mapping = method.mapping()?;
        let table = read_presses(&path, &mapping, Some(Phase::Calibration), note)?;
        let calibration = table_by(&table, load, quantity(method.quantity)).map_err(Failure::usage)?;
        let is_relative = table.presses.iter().any(|press| press.force_n.is_none());
        let layout = mapping.layout_of(table.channels);
        Ok(FitSource { path, calibration, layout, sensor: None, is_relative })
    }

    /// Reads a sensor file too, which keeps its presses.
    pub(crate) fn read_older(path: &Path, method: &MethodOptions, note: Note<'_>) -> Result<FitSource, Failure> {
        if !is_sensor_file(path) {
            return FitSource::read(path, method, note);
        }
        let (card, model) = read_sensor_file(path).map_err(Failure::usage)?;
        let Some(calibration) = model.calibration() else {
            let help = "give the run or the table that it was made from";
            return Err(Failure::usage(miette::miette!(help = help, "{} contains no presses", path.display())));
        };
        let (calibration, layout) = (calibration.clone(), model.setting().layout.cloned());
        let is_relative = card.valid.force_n.is_none();
        Ok(FitSource { path: path.to_owned(), calibration, layout, sensor: card.sensor, is_relative })
    }

    /// The journal or the file by its content.
    pub(crate) fn fingerprint(&self) -> Result<Fingerprint, Failure> {
        stdin::fingerprint(&self.path).map_err(Failure::dataset)
    }
}

impl Default for MethodOptions {
    fn default() -> Self {
        MethodOptions {
            solver: BEST.to_owned(),
            constant_load: false,
            quantity: None,
            common_offset: false,
            false_alarms: Setting::default().false_alarms,
            forces_n: Vec::new(),
            vector: false,
            history: false,
            columns: ColumnsOptions::default(),
        }
    }
}

impl MethodOptions {
    /// Checks what the types of the options allow but a fit doesn't.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        check_solver(&self.solver, &[BEST])?;
        let refused = |why: String| Failure::option("--false-alarms", self.false_alarms, &why);
        share(&self.false_alarms.to_string()).map_err(refused)?;
        self.forces_n().map(drop)
    }

    /// Whether contacts press as hard as the calibration.
    pub(crate) fn load(&self) -> ForceKnown {
        load(self.constant_load)
    }

    /// What the columns of tables and readings hold.
    pub(crate) fn mapping(&self) -> Result<Mapping, Failure> {
        self.columns.mapping()
    }

    /// The name of the method.
    pub(crate) fn solver(&self) -> &str {
        &self.solver
    }

    /// The setting for a calibration.
    pub(crate) fn setting<'s>(&self, source: &'s FitSource) -> Result<Setting<'s>, Failure> {
        Ok(Setting {
            layout: source.layout.as_ref(),
            load: self.load(),
            common_offset: self.common_offset,
            false_alarms: self.false_alarms,
            forces_n: self.forces_n()?,
            ..Setting::default()
        })
    }

    /// Fits the method to a calibration.
    pub(crate) fn fit(&self, source: &FitSource) -> Result<Model, Failure> {
        let name = source.path.display();
        check_places(&name.to_string(), &source.calibration).map_err(Failure::usage)?;
        let model = Model::fit(&self.solver, source.calibration.clone(), &self.setting(source)?).into_diagnostic();
        model.wrap_err_with(|| format!("{name}: can't be used as a calibration")).map_err(Failure::usage)
    }

    fn forces_n(&self) -> Result<Option<(f64, f64)>, Failure> {
        match self.forces_n.as_slice() {
            [] => Ok(None),
            [least, most] if 0.0 < *least && least < most && most.is_finite() => Ok(Some((*least, *most))),
            _ => Err(Failure::usage(miette::miette!("--forces-n: the first force must be smaller than the second"))),
        }
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(share),
        _ => Err("expected a number between 0 and 1, such as 0.01".to_owned()),
    }
}

fn force(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(force_n) if force_n.is_finite() && force_n > 0.0 => Ok(force_n),
        _ => Err("expected a force above 0 N".to_owned()),
    }
}
