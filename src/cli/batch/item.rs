//! One sensor of a batch: warm-up, quick check, runs, evaluation and verdict.

use super::super::exit;
use super::super::progress::Progress;
use super::super::summary::{self, tell};
use super::super::tables::filled;
use super::super::which_way::asked_at;
use super::big::big;
use super::desk::{Desk, Placed};
use super::material::{Material, NestRig};
use crate::api::Failure;
use crate::api::MannerOptions;
use crate::api::provenance::{now, session};
use crate::api::run::{block_on, executed};
use palpate_data::acceptance::{Judgement, SensorVerdict, limit_used};
use palpate_data::dataset::sensor_file::SensorFile;
use palpate_data::dataset::{DatasetError, Labels, Recorded, RunFacts, RunFolder, Status, source_fingerprint};
use palpate_data::recipe::Plan;
use palpate_link::time::{sleep, spawn};
use palpate_run::batch::chart::{ChartedChange, LIMIT_SIGMAS};
use palpate_run::batch::{
    Admitted, Alarm, Basis, BatchEvent, BatchSensor, Began, Cause, Conclusion, Ended, SensorFigure, SensorState,
    conclude, run_seed, specimen_seed,
};
use palpate_run::run::{Ending, ForceCheck, Halt, examine, keep_pace};
use palpate_solver::{Model, UnitChange};
use std::fmt::Write as _;
use std::fs;
use std::time::Duration;

/// Minutes of a run that is timed in seconds.
const SECONDS_PER_MINUTE: f64 = 60.0;

/// Folder of a batch with the files of its calibrated sensors, and their extension.
const SENSORS: &str = "sensors";
const SENSOR_FILE: &str = "palpate";

/// Whether the batch continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flow {
    /// With the next sensor.
    Next,
    /// It doesn't: a person stopped it.
    Cancelled,
}

/// A sensor with everything that its runs need.
struct PreparedSensor {
    placed: Placed,
    rig: NestRig,
    /// Number of its first run, from 1.
    number: u64,
    first: Plan,
}

/// What is known when a sensor's runs end.
struct ItemOutcome {
    status: Status,
    runs: Vec<String>,
    minutes: f64,
    reasons: Vec<String>,
    judgement: Option<Judgement>,
    presses: (usize, usize),
    change: Vec<UnitChange>,
    is_refused: bool,
    model: Option<Model>,
    /// Failure to report to the person.
    failure: Option<Failure>,
    /// Whether the batch can't continue after this failure.
    is_fatal: bool,
}

impl Desk {
    /// Calibrates the sensors on the tray, one after another.
    pub(super) fn calibrate(&mut self, tray: &[Placed], manner: &MannerOptions) -> Result<Flow, Failure> {
        // all plans are made before anything moves
        let prepared: Result<Vec<PreparedSensor>, Failure> =
            tray.iter().map(|placed| self.prepare(placed, manner)).collect();
        let prepared = prepared?;
        if self.warm_up(manner)? == Flow::Cancelled {
            return Ok(Flow::Cancelled);
        }
        for sensor in prepared {
            if self.one(&sensor, manner)? == Flow::Cancelled {
                return Ok(Flow::Cancelled);
            }
        }
        Ok(Flow::Next)
    }

    fn prepare(&self, placed: &Placed, manner: &MannerOptions) -> Result<PreparedSensor, Failure> {
        let mut rig = self.material.rig_at(placed.nest.as_ref())?;
        rig.spec = asked_at(&manner.confirm, rig.spec);
        let (seed, serial) = (self.folder.state().facts.seed, placed.serial.as_str());
        rig.spec.scene.specimen = Some(specimen_seed(seed, serial));
        let number = 1 + self.folder.state().item(serial).map_or(0, |item| item.times);
        let first = self.material.plan(0, &rig.spec, run_seed(seed, serial, number))?;
        Ok(PreparedSensor { placed: placed.clone(), rig, number, first })
    }

    /// Waits until the sensors have the bench's temperature.
    fn warm_up(&self, manner: &MannerOptions) -> Result<Flow, Failure> {
        let warm_up_s = self.material.file.warm_up_s;
        if warm_up_s > 0.0 {
            tell(&format!("warm-up: {warm_up_s} s; Ctrl-C stops\n"))?;
            block_on(self.material.rig.is_simulated(), async {
                if let Some(pace) = manner.pace {
                    drop(spawn(keep_pace(pace)));
                }
                tokio::select! {
                    biased;
                    () = self.cancel.wait() => {}
                    () = sleep(Duration::from_secs_f64(warm_up_s)) => {}
                }
            })?;
        }
        Ok(if self.cancel.asked() { Flow::Cancelled } else { Flow::Next })
    }

    fn one(&mut self, sensor: &PreparedSensor, manner: &MannerOptions) -> Result<Flow, Failure> {
        let Placed { serial, kind, nest } = &sensor.placed;
        let is_reference = *kind == Admitted::Reference;
        let run = self.folder.next_run(serial).map_err(Failure::batch)?;
        let place = nest.as_ref().map(|nest| format!(" in the nest {}", nest.name)).unwrap_or_default();
        tell(&format!("{serial}{place}: {run}\n"))?;
        let nest = nest.as_ref().map(|nest| nest.name.clone());
        let began = Began { at: now(), serial: serial.clone(), reference: is_reference, nest, run: run.clone() };
        self.record(&BatchEvent::Began(began))?;
        let mut outcome = match self.quick_check(sensor)? {
            Some(failed) => failed,
            None => self.runs(sensor, run, manner)?,
        };
        let judgement = outcome.judgement.take();
        let model = outcome.model.take().filter(|_| !is_reference);
        let model = model.map(|model| self.write_model(serial, &outcome.runs, model)).transpose()?;
        let ended = Ended {
            at: now(),
            serial: serial.clone(),
            reference: is_reference,
            runs: outcome.runs,
            status: outcome.status,
            verdict: judgement.as_ref().map(|judgement| judgement.verdict).filter(|_| !is_reference),
            // a reference sensor isn't judged
            reasons: if is_reference && judgement.is_some() { Vec::new() } else { outcome.reasons },
            found: judgement.iter().flat_map(|judgement| &judgement.checks).map(SensorFigure::of).collect(),
            calibration_presses: outcome.presses.0,
            test_presses: outcome.presses.1,
            minutes: outcome.minutes,
            change: outcome.change,
            refused: outcome.is_refused,
            model,
        };
        self.record(&BatchEvent::Ended(ended))?;
        self.alarms(serial)?;
        let is_stopped = outcome.status == Status::Stopped;
        if let Some(failure) = outcome.failure {
            if outcome.is_fatal {
                return Err(failure);
            }
            _ = exit::report(failure); // its exit code is that of a command which ends here
        }
        let item = self.folder.state().item(serial).cloned().unwrap_or_default();
        self.show(&result(&item, judgement.as_ref(), self.is_on_screen()))?;
        Ok(if is_stopped { Flow::Cancelled } else { Flow::Next })
    }

    /// Checks without pressing that every device answers, and that zero and noise are sound. Returns the end of a sensor that fails.
    fn quick_check(&self, sensor: &PreparedSensor) -> Result<Option<ItemOutcome>, Failure> {
        let spec = &sensor.rig.spec;
        let found = block_on(spec.is_simulated(), examine(spec, sensor.first.seed, &self.cancel, ForceCheck::Nobody))?;
        let halt = match found {
            Err(halt) => Some(halt),
            Ok(found) => {
                let device = found.devices.into_iter().find_map(|(_, device)| device.err()).map(Halt::from);
                device.or_else(|| found.no_load.and_then(Result::err).map(Halt::from))
            }
        };
        Ok(halt.map(|halt| ItemOutcome::halted(Ending::halted(halt), Vec::new(), 0.0)))
    }

    /// Executes the first recipe, and further ones as long as the result requires more presses.
    fn runs(&self, sensor: &PreparedSensor, first: String, manner: &MannerOptions) -> Result<ItemOutcome, Failure> {
        let (mut runs, mut seconds) = (Vec::new(), 0.0);
        let (mut recipe, mut plan, mut name) = (0, sensor.first.clone(), first);
        loop {
            let mut folder = self.new_run(sensor, recipe, &plan, &name, manner)?;
            runs.push(name);
            let paused = || self.pauses(&sensor.placed.serial);
            let mut progress = Progress::new(&plan, 0, false, self.cancel.clone()).pausing(paused).warned(&self.warned);
            let (shown, spec) = (progress.watched_cell(), &sensor.rig.spec);
            let executed = executed(&plan, spec, &mut folder, manner.pace, &self.cancel, (&*shown, &mut progress));
            progress.end();
            let (ending, finished) = executed?;
            summary::warn(&folder)?;
            seconds += ending.t_s;
            finished.map_err(Failure::unfinished)?;
            let minutes = seconds / SECONDS_PER_MINUTE;
            drop(folder);
            if ending.status() != Status::Complete {
                return Ok(ItemOutcome::halted(ending, runs, minutes));
            }
            let is_last = recipe + 1 == self.material.recipes.len();
            let conclusion = self.concluded(&runs, is_last).map_err(Failure::dataset)?;
            match conclusion.needs_more && !is_last {
                false => return Ok(ItemOutcome::complete(conclusion, runs, minutes)),
                true => {
                    recipe += 1;
                    let number = sensor.number + runs.len() as u64;
                    let (seed, serial) = (self.folder.state().facts.seed, &sensor.placed.serial);
                    plan = self.material.plan(recipe, &sensor.rig.spec, run_seed(seed, serial, number))?;
                    name = self.folder.next_run(serial).map_err(Failure::batch)?;
                }
            }
        }
    }

    fn new_run(
        &self,
        sensor: &PreparedSensor,
        recipe: usize,
        plan: &Plan,
        name: &str,
        manner: &MannerOptions,
    ) -> Result<RunFolder, Failure> {
        let state = self.folder.state();
        let item = state.item(&sensor.placed.serial);
        let labels = Labels {
            sensor: Some(sensor.placed.serial.clone()),
            design: Some(state.facts.design.clone()),
            batch: Some(state.facts.name.clone()),
            mounting: Some(format!("{}-{}", state.facts.name, state.mountings)),
            operator: self.operator.clone(),
            note: item.and_then(|item| item.note.clone()),
        };
        let spec = &sensor.rig.spec;
        let specimen = if spec.is_simulated() { spec.scene.specimen } else { None };
        let (without_load_cell, three_axes) = (!spec.has_load_cell(), spec.has_three_axes());
        let begun = RunFacts::new(plan, spec.is_simulated());
        let facts = RunFacts { labels, specimen, without_load_cell, three_axes, ..begun };
        let origins = self.material.origins(recipe, &sensor.rig);
        let path = self.folder.path().join(name);
        RunFolder::create(Some(&path), &origins, facts, session(manner.durability.into()), &spec.array.layout)
            .map_err(Failure::dataset)
    }

    /// Concludes from all runs of a sensor together.
    fn concluded(&self, runs: &[String], is_last: bool) -> Result<Conclusion, DatasetError> {
        let read = runs.iter().map(|run| Recorded::read(&self.folder.path().join(run)));
        let recorded = read.collect::<Result<Vec<Recorded>, DatasetError>>()?;
        let Material { rig, rule, prior, file, .. } = &self.material;
        let enough_mm = file.prior.as_ref().and_then(|prior| prior.enough_mm);
        let basis = Basis { rig, rule: rule.as_ref(), prior: prior.as_ref(), enough_mm };
        Ok(conclude(&recorded, &basis, is_last))
    }

    /// Writes the file of a calibrated sensor that isn't refused. Returns its path, relative to the batch folder.
    fn write_model(&self, serial: &str, runs: &[String], model: Model) -> Result<String, Failure> {
        let paths = runs.iter().map(|run| self.folder.path().join(run));
        let made_from =
            paths.map(|path| source_fingerprint(&path)).collect::<Result<_, _>>().map_err(Failure::dataset)?;
        let file = SensorFile::new(model, Some(serial.to_owned()), made_from).map_err(Failure::usage)?;
        let folder = self.folder.path().join(SENSORS);
        let name = format!("{SENSORS}/{serial}.{SENSOR_FILE}");
        let made = fs::create_dir_all(&folder).map_err(DatasetError::io("making", &folder));
        made.map_err(Failure::dataset)?;
        file.write(&self.folder.path().join(&name)).map_err(Failure::unwritten)?;
        Ok(name)
    }

    /// Records the alarms of the control charts after a result, and shows them.
    fn alarms(&mut self, serial: &str) -> Result<(), Failure> {
        let shown = self.folder.state().monitor.shown().to_vec();
        for (quantity, ChartedChange { cause, sigmas }) in shown {
            let (serial, quantity) = (serial.to_owned(), quantity.name().to_owned());
            let what = match cause {
                Cause::Bench => {
                    "THE BENCH HAS CHANGED: check the mounting, the load cell and the array before the next sensor"
                }
                Cause::Batch => "THE SENSORS HAVE CHANGED: those since the last alarm differ from the design",
            };
            self.show(&filled(&format!("{what} ({quantity}: {sigmas:+.1} standard deviations)"), "  "))?;
            self.record(&BatchEvent::Alarm(Alarm { at: now(), serial, cause, quantity, sigmas, limit: LIMIT_SIGMAS }))?;
        }
        Ok(())
    }
}

impl ItemOutcome {
    fn complete(conclusion: Conclusion, runs: Vec<String>, minutes: f64) -> ItemOutcome {
        let Conclusion { judgement, presses, change, is_refused, reasons, model, .. } = conclusion;
        let reasons = reasons.into_iter().chain(judgement.iter().flat_map(Judgement::all_reasons)).collect();
        let (failure, is_fatal) = (None, false);
        let status = Status::Complete;
        ItemOutcome { status, runs, minutes, reasons, judgement, presses, change, is_refused, model, failure, is_fatal }
    }

    /// Returns the end of a sensor whose run, or whose quick check, ended early.
    fn halted(ending: Ending, runs: Vec<String>, minutes: f64) -> ItemOutcome {
        let status = ending.status();
        let reasons = ending.text().into_iter().collect();
        let is_fatal = ending.unparked.is_some() || matches!(ending.halt, Some(Halt::Record(_) | Halt::Unconfirmed(_)));
        // a person knows why they stopped it
        let is_cancelled = matches!(ending, Ending { halt: Some(Halt::Cancelled), unparked: None, .. });
        let failure = (!is_cancelled).then(|| Failure::ended(ending));
        ItemOutcome {
            status,
            runs,
            minutes,
            reasons,
            judgement: None,
            presses: (0, 0),
            change: Vec::new(),
            is_refused: false,
            model: None,
            failure,
            is_fatal,
        }
    }
}

/// Returns a sensor's result for the person: large on a screen, and the figure that is nearest to its limit, or farthest beyond it.
fn result(item: &BatchSensor, judgement: Option<&Judgement>, is_on_screen: bool) -> String {
    let mut text = String::new();
    // writing to a string can't fail
    if is_on_screen {
        let _ = writeln!(text, "\n{}\n{}", big(item.sensor_state), item.serial);
    } else {
        let _ = writeln!(text, "{} {}", item.serial, item.sensor_state.name().to_uppercase());
    }
    if let Some(judgement) = judgement {
        let worst = judgement.checks.iter().filter_map(|check| {
            Some((check, limit_used(check.kind.is_share(), check.bound.or(check.value)?, check.limit)))
        });
        if let Some((check, _)) = worst.max_by(|one, other| one.1.total_cmp(&other.1)) {
            let (name, unit) = (check.kind.full_name(check.reach), check.kind.unit());
            let line =
                format!("{name} {} {unit}, limit {} {unit}", check.shown(check.value), check.shown(Some(check.limit)));
            text += &filled(&format!("  {}", line.replace(" ,", ",").trim_end()), "    ");
        }
        let is_listed = judgement.verdict != SensorVerdict::Accepted && item.sensor_state != SensorState::Calibrated;
        for reason in judgement.all_reasons().filter(|_| is_listed) {
            text += &filled(&format!("  {reason}"), "    ");
        }
    } else if let Some(reason) = &item.reason {
        text += &filled(&format!("  {reason}"), "    ");
    }
    if !item.sensor_state.is_judged() {
        let _ = writeln!(text, "  to calibrate it again: .repeat {0}, then {0}", item.serial);
    }
    text
}
