//! How a method is asked for on the command line, and fitted to a run or a table.

use super::columns::ColumnsArgs;
use super::exit::Failure;
use super::recorded::{noted_presses, noted_run};
use super::stdin;
use super::summary::tell;
use super::tables::{chosen, filled};
use clap::builder::PossibleValuesParser;
use miette::{IntoDiagnostic, WrapErr};
use palpate_core::quantity::ArrayLayout;
use palpate_data::dataset::calibration::{calibration_of_run, calibration_of_table, check_places};
use palpate_data::dataset::sensor_file::{is_sensor_file, read_sensor_file};
use palpate_data::dataset::{Fingerprint, Manifest, Mapping, Status};
use palpate_data::recipe::Phase;
use palpate_solver::{
    BEST, Broken, Calibration, CalibrationPoint, Fitted, ForceKnown, Model, Prepared, SOLVERS, Setting, Solver as _,
    Validity,
};
use std::path::{Path, PathBuf};

/// Every name a method can be asked for by, with some more.
pub(super) fn solvers<const MORE: usize>(more: [&'static str; MORE]) -> PossibleValuesParser {
    PossibleValuesParser::new(more.into_iter().chain(SOLVERS))
}

/// Knowledge of the forces, by `--constant-load`.
pub(super) fn load(is_constant: bool) -> ForceKnown {
    if is_constant { ForceKnown::Constant } else { ForceKnown::Unknown }
}

/// The method, and what contacts to expect.
#[derive(Debug, clap::Args)]
pub(super) struct MethodArgs {
    /// The method; best selects by cross-validation on the calibration
    #[arg(long, value_name = "NAME", default_value = BEST, value_parser = solvers([BEST]))]
    solver: String,
    /// Assume that every contact has the force of the calibration
    #[arg(long)]
    constant_load: bool,
    /// Also solve for an offset that is the same for all outputs
    #[arg(long)]
    common_offset: bool,
    /// Accepted share of single contacts with a wrong verdict
    #[arg(long, value_name = "SHARE", default_value_t = Setting::default().false_alarms, value_parser = share)]
    false_alarms: f64,
    /// Expected forces, N, if the calibration has one force [default: from a tenth of that force to that force]
    #[arg(long, num_args = 2, value_names = ["MIN", "MAX"], value_parser = force, conflicts_with = "constant_load")]
    forces_n: Option<Vec<f64>>,
    #[command(flatten)]
    columns: ColumnsArgs,
}

/// Ratio of two errors below which the gain is worth a note.
const LESS: f64 = 0.9;

/// What the forces of a calibration without forces are.
pub(super) const FORCES_ARE_RELATIVE: &str =
    "no force_n in the calibration: relative_force is relative to its typical press\n";

/// What a method is fitted to.
pub(super) struct Source {
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
    /// What a person should know about its files.
    pub notes: Vec<String>,
}

impl Source {
    /// Reads a run folder or a table of presses, and prints the notes.
    pub(super) fn read(path: &Path, method: &MethodArgs) -> Result<Source, Failure> {
        let source = Source::noted(path, method)?;
        source.notes.iter().try_for_each(|note| tell(note))?;
        Ok(source)
    }

    /// Reads a run folder or a table of presses.
    pub(super) fn noted(path: &Path, method: &MethodArgs) -> Result<Source, Failure> {
        let load = method.load();
        let path = path.to_owned();
        if path.is_dir() {
            let (recorded, bench, mut notes) = noted_run(&path)?;
            let Manifest { status, presses_done, facts, .. } = &recorded.manifest;
            if *status != Status::Complete {
                let (name, status, planned) = (path.display(), status.name(), facts.presses_planned);
                notes.push(format!("note: {name} is {status}: {presses_done} of {planned} presses\n"));
            }
            let calibration = calibration_of_run(&recorded.presses(), load).map_err(Failure::usage)?;
            let (layout, sensor) = (bench.placed().cloned(), recorded.manifest.facts.labels.sensor.clone());
            return Ok(Source { path, calibration, layout, sensor, is_relative: false, notes });
        }
        let mapping = method.mapping()?;
        let (table, notes) = noted_presses(&path, &mapping, Some(Phase::Calibration))?;
        let calibration = calibration_of_table(&table, load).map_err(Failure::usage)?;
        let is_relative = table.presses.iter().any(|press| press.force_n.is_none());
        let layout = mapping.layout_of(table.channels);
        Ok(Source { path, calibration, layout, sensor: None, is_relative, notes })
    }

    /// Reads a sensor file too, which keeps its presses.
    pub(super) fn read_older(path: &Path, method: &MethodArgs) -> Result<Source, Failure> {
        if !is_sensor_file(path) {
            return Source::read(path, method);
        }
        let (card, model) = read_sensor_file(path).map_err(Failure::usage)?;
        let Some(calibration) = model.calibration() else {
            let help = "give the run or the table that it was made from";
            return Err(Failure::usage(miette::miette!(help = help, "{} contains no presses", path.display())));
        };
        let (calibration, layout) = (calibration.clone(), model.setting().layout.cloned());
        let is_relative = card.valid.force_n.is_none();
        let (path, notes) = (path.to_owned(), Vec::new());
        Ok(Source { path, calibration, layout, sensor: card.sensor, is_relative, notes })
    }

    /// The journal or the file by its content.
    pub(super) fn fingerprint(&self) -> Result<Fingerprint, Failure> {
        stdin::fingerprint(&self.path).map_err(Failure::dataset)
    }
}

impl MethodArgs {
    /// Whether contacts press as hard as the calibration.
    pub(super) fn load(&self) -> ForceKnown {
        load(self.constant_load)
    }

    /// What the columns of tables and readings hold.
    pub(super) fn mapping(&self) -> Result<Mapping, Failure> {
        self.columns.mapping()
    }

    /// The name of the method.
    pub(super) fn solver(&self) -> &str {
        &self.solver
    }

    /// The setting for a calibration.
    pub(super) fn setting<'s>(&self, source: &'s Source) -> Result<Setting<'s>, Failure> {
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
    pub(super) fn fit(&self, source: &Source) -> Result<Model, Failure> {
        let name = source.path.display();
        check_places(&name.to_string(), &source.calibration).map_err(Failure::usage)?;
        let model = Model::fit(&self.solver, source.calibration.clone(), &self.setting(source)?).into_diagnostic();
        model.wrap_err_with(|| format!("{name}: can't be used as a calibration")).map_err(Failure::usage)
    }

    /// Prints the method, its calibration, and the reason for the choice.
    pub(super) fn tell(&self, source: &Source, model: &Model) -> Result<(), Failure> {
        tell(&format!("{}\n", fitted_to(model.fitted().name(), model.validity())))?;
        tell(&model.fitted().choice().map(chosen).unwrap_or_default())?;
        if source.is_relative && !self.constant_load {
            tell(FORCES_ARE_RELATIVE)?;
        }
        Ok(())
    }

    /// For a calibration without forces, prints what `--constant-load` would gain, by the same method on held-out presses.
    pub(super) fn tell_constant_load(&self, source: &Source, model: &Model) -> Result<(), Failure> {
        if !source.is_relative || self.constant_load || model.fitted().at_calibrated_load().is_some() {
            return Ok(());
        }
        let setting = self.setting(source)?;
        let error_mm = |calibration: Calibration, load: ForceKnown| {
            let prepared = Prepared::new(calibration, &Setting { load, ..setting }).ok()?;
            prepared.candidates(model.fitted().name()).ok()?.first()?.location_error_mm
        };
        let points: Vec<_> =
            source.calibration.points().map(|point| CalibrationPoint { force_n: 1.0, ..point }).collect();
        let alike = Calibration::new(&points).ok().map(Calibration::with_unknown_forces);
        let constant_mm = alike.and_then(|alike| error_mm(alike, ForceKnown::Constant));
        // `best` has compared the methods already
        let any_mm = match model.fitted().choice().and_then(|choice| choice.candidates.first()) {
            Some(chosen) => chosen.location_error_mm,
            None => error_mm(source.calibration.clone(), ForceKnown::Unknown),
        };
        let Some((any_mm, constant_mm)) = any_mm.zip(constant_mm) else { return Ok(()) };
        if constant_mm > LESS * any_mm {
            return Ok(());
        }
        tell(&filled(
            &format!(
                "note: if every contact presses as hard as the calibration, --constant-load lowers the error on held-out presses from \
                 {any_mm:.3} to {constant_mm:.3} mm; with other forces it is larger"
            ),
            "  ",
        ))
    }

    fn forces_n(&self) -> Result<Option<(f64, f64)>, Failure> {
        match self.forces_n.as_deref() {
            Some([least, most]) if least < most => Ok(Some((*least, *most))),
            None => Ok(None),
            Some(_) => {
                Err(Failure::usage(miette::miette!("--forces-n: the first force must be smaller than the second")))
            }
        }
    }
}

/// Which method was fitted to how much.
pub(super) fn fitted_to(method: &str, Validity { presses, units, .. }: &Validity) -> String {
    format!("{method}, fitted to {presses} presses of {units} outputs")
}

/// Says which units of a calibration are left out of account.
pub(super) fn tell_left_out(path: &Path, fitted: &Fitted) -> Result<(), Failure> {
    left_out(path, fitted).try_for_each(|line| tell(&line))
}

/// A line for each unit of a calibration that is left out of account.
pub(super) fn left_out(path: &Path, fitted: &Fitted) -> impl Iterator<Item = String> {
    let line = |Broken { unit, fault }: &Broken| {
        format!("{}: output {} {}, excluded\n", path.display(), unit + 1, fault.told())
    };
    fitted.broken().iter().map(line)
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
