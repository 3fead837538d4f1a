//! `palpate.run` and `palpate.simulate`: runs on a rig, with their events.

use super::given::noted;
use super::refused::{raised, warn};
use super::run::{PyRun, load};
use palpate::api::events::{Next, RunEvent, RunEvents, RunThread};
use palpate::api::{
    self, ConfirmOptions, Confirmed, DurabilityChoice, Failure, LabelOptions, MannerOptions, ResumeOptions, Resumed,
    RigOptions, RunOptions,
};
use palpate_core::parallel::lock;
use palpate_data::dataset::{CellValue, Press, Retouch};
use palpate_link::device::Identity;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict as _, PyCFunction, PyDict, PyTuple};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::time::Duration;

/// Time after which a wait looks whether Python has received a signal, such as Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Runs under way, which are parked when the interpreter ends.
static RUNNING: Mutex<Vec<Weak<RunThread>>> = Mutex::new(Vec::new());

/// The events of a run, an iterator of dicts.
///
/// A press that is on disk is the dict of a line of `palpate run --json`: press, level, phase, x_mm, y_mm (mm), force_n (N), t_s
/// (s), out_1 to out_n (the array's unit), ... Every press is there, however slowly the events are taken, and the run never
/// waits.
///
/// Other events have the key `event`: `ready` (devices), `begins` (press, phase), `retouched` (x_mm, y_mm, before_mm, touched_mm),
/// `rests` (rest_s), and at the end `ended` (status: complete or stopped; out). Events about the progress, which are all but the
/// last, are lost if they aren't taken.
///
/// The iterator raises `DeviceError`, `TripError` or `RecordError` if the run fails. The run is stopped and the stage is parked
/// when the iterator is closed, leaves its `with` block or is deleted, and when Python ends. No signal handler is installed:
/// Ctrl-C raises KeyboardInterrupt, as anywhere in Python.
#[pyclass(name = "Events", module = "palpate", frozen)]
pub struct PyEvents {
    out: PathBuf,
    planned: usize,
    runner: Arc<RunThread>,
    /// `None` while a thread waits for the next event, and when the events are closed.
    heard: Mutex<Option<RunEvents>>,
    is_closed: AtomicBool,
}

/// Runs a recipe on a rig and records every press, like `palpate run`. Returns the events.
///
/// `recipe` and `rig` are files, or names of shipped ones; without a rig it is that of the recipe's key `rig`, or
/// `rig.toml` in its folder, and must be simulated. `out` is the folder of the run [runs/NAME]. `simulate` replaces the rig's links by
/// emulators. `seed`, `strategy` and `presses_max` are those of `palpate run`, and so are the labels `sensor`, `design`, `batch`,
/// `mounting`, `operator` and `note`. `pace` runs a simulation at so many times real time. `durability` is full or fast. `confirmed` is
/// what a person has made sure of: down, home, clear. The run never asks.
///
/// The run goes on in a thread of its own. Raises `UsageError` for bad input; nothing has moved then.
#[pyfunction]
#[pyo3(signature = (
    recipe, rig=None, out=None, *, seed=1, simulate=false, strategy=None, presses_max=None, sensor=None, design=None, batch=None,
    mounting=None, operator=None, note=None, pace=None, durability=None, confirmed=Vec::new()
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn run(
    py: Python<'_>,
    recipe: PathBuf,
    rig: Option<PathBuf>,
    out: Option<PathBuf>,
    seed: u64,
    simulate: bool,
    strategy: Option<String>,
    presses_max: Option<usize>,
    sensor: Option<String>,
    design: Option<String>,
    batch: Option<String>,
    mounting: Option<String>,
    operator: Option<String>,
    note: Option<String>,
    pace: Option<f64>,
    durability: Option<String>,
    confirmed: Vec<String>,
) -> PyResult<PyEvents> {
    let begun = || {
        let strategy = strategy.map(|name| api::strategy(&name)).transpose()?;
        let options = RunOptions {
            recipe,
            rig: RigOptions { rig, simulate, seed, strategy, presses_max },
            labels: LabelOptions { sensor, design, batch, mounting, operator, note },
            out,
            manner: manner(pace, durability, &confirmed)?,
        };
        RunEvents::start(api::begin(&options)?)
    };
    Ok(PyEvents::of(py.detach(begun).map_err(raised)?))
}

/// Continues a run that was stopped, like `palpate resume`. Returns the events of the remaining presses.
///
/// `rig` is the rig to continue with: links and commands of processes may differ, limits may be tighter. `after_trip` continues
/// after a safety trip, once you have found its cause. `sound` repeats and flags a press that this rule stopped falsely; with
/// `from_here` it compares no later press. `pace`, `durability` and `confirmed` are those of `run`. The events of a complete run are
/// only `ended`.
///
/// Raises `UsageError` for bad input; nothing has moved then. Warns of each difference from the rig with which the run began.
#[pyfunction]
#[pyo3(signature = (run, rig=None, *, after_trip=false, sound=None, from_here=false, pace=None, durability=None, confirmed=Vec::new()))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn resume(
    py: Python<'_>,
    run: PathBuf,
    rig: Option<PathBuf>,
    after_trip: bool,
    sound: Option<String>,
    from_here: bool,
    pace: Option<f64>,
    durability: Option<String>,
    confirmed: Vec<String>,
) -> PyResult<PyEvents> {
    let resumed = || {
        let manner = manner(pace, durability, &confirmed)?;
        let sound = sound.map(|rule| api::choice("--sound", &rule)).transpose()?;
        let options = ResumeOptions { run, rig, after_trip, sound, from_here, manner };
        let (resumed, notes) = noted(|note| api::resume(&options, note))?;
        let heard = match resumed {
            Resumed::Begun(begun) => RunEvents::start(*begun)?,
            Resumed::Complete { planned, .. } => RunEvents::of_complete(options.run, planned),
        };
        Ok((heard, notes))
    };
    let (heard, notes) = py.detach(resumed).map_err(raised)?;
    warn(py, &notes)?;
    Ok(PyEvents::of(heard))
}

/// How the rig is driven.
fn manner(pace: Option<f64>, durability: Option<String>, confirmed: &[String]) -> Result<MannerOptions, Failure> {
    let durability = durability.map(|word| api::choice("--durability", &word)).transpose()?;
    let confirmed = confirmed.iter().map(|what| api::choice("--confirmed", what));
    let confirm = ConfirmOptions { confirmed: confirmed.collect::<Result<Vec<Confirmed>, Failure>>()? };
    Ok(MannerOptions { pace, durability: durability.unwrap_or(DurabilityChoice::Full), confirm })
}

impl PyEvents {
    fn of(heard: RunEvents) -> Self {
        let runner = heard.runner().clone();
        let mut running = lock(&RUNNING);
        running.retain(|runner| runner.strong_count() > 0);
        running.push(Arc::downgrade(&runner));
        drop(running);
        PyEvents {
            out: heard.path().to_owned(),
            planned: heard.planned(),
            runner,
            heard: Mutex::new(Some(heard)),
            is_closed: AtomicBool::new(false),
        }
    }
}

/// Simulates a calibration and returns its run: the shipped recipe `calibrate` on the simulated rig `sim`, if no others are given.
///
/// `out` is the folder of the run [runs/NAME]. Virtual time passes as fast as the computer allows.
#[pyfunction]
#[pyo3(signature = (recipe=None, rig=None, out=None, *, seed=1))]
pub fn simulate(
    py: Python<'_>,
    recipe: Option<PathBuf>,
    rig: Option<PathBuf>,
    out: Option<PathBuf>,
    seed: u64,
) -> PyResult<PyRun> {
    let options = RunOptions {
        recipe: recipe.unwrap_or_else(|| DEFAULT_RECIPE.into()),
        rig: RigOptions { rig, simulate: true, seed, ..RigOptions::default() },
        out,
        ..RunOptions::default()
    };
    let mut heard = py.detach(|| RunEvents::start(api::begin(&options)?)).map_err(raised)?;
    while next(py, &mut heard)?.is_some() {}
    load(py, heard.path().to_owned(), None)
}

/// Recipe of `simulate`.
const DEFAULT_RECIPE: &str = "calibrate";

/// Waits for the next event without the interpreter's lock.
fn next(py: Python<'_>, heard: &mut RunEvents) -> PyResult<Option<RunEvent>> {
    loop {
        match py.detach(|| heard.next(LOOK_EVERY)) {
            Next::Event(event) => return Ok(Some(event)),
            Next::Waiting => py.check_signals()?,
            Next::Failed(failure) => return Err(raised(failure)),
            Next::Over => return Ok(None),
        }
    }
}

#[pymethods]
impl PyEvents {
    /// The folder of the run.
    #[getter]
    fn out(&self) -> PathBuf {
        self.out.clone()
    }

    /// Number of presses of the plan.
    #[getter]
    fn planned(&self) -> usize {
        self.planned
    }

    /// Latest reading of the load cell, N, relative to its zero.
    #[getter]
    fn force_n(&self) -> f64 {
        self.runner.force_n()
    }

    /// Stops the run after the press under way, as Ctrl-C does on the command line. The remaining events still follow.
    fn stop(&self) {
        self.runner.stop();
    }

    /// Stops the run at once, and returns when the stage is parked. No event follows.
    fn close(&self, py: Python<'_>) {
        self.is_closed.store(true, Ordering::SeqCst);
        let heard = lock(&self.heard).take();
        py.detach(|| {
            self.runner.park();
            drop(heard);
        });
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let heard = lock(&self.heard).take();
        let Some(mut heard) = heard else {
            let waits = || PyRuntimeError::new_err("another thread waits for the next event");
            return if self.is_closed.load(Ordering::SeqCst) { Ok(None) } else { Err(waits()) };
        };
        let event = next(py, &mut heard);
        if self.is_closed.load(Ordering::SeqCst) {
            py.detach(|| drop(heard));
        } else {
            *lock(&self.heard) = Some(heard);
        }
        event?.map(|event| worded(py, event, &self.out)).transpose()
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self) -> String {
        format!("<palpate.Events of {}>", self.out.display())
    }
}

impl Drop for PyEvents {
    fn drop(&mut self) {
        let mut heard = lock(&self.heard).take();
        // other threads of Python continue while the stage is parked
        _ = Python::try_attach(|py| py.detach(|| drop(heard.take())));
    }
}

/// Stops and parks all runs when the interpreter ends.
pub fn park_at_exit(py: Python<'_>) -> PyResult<()> {
    let park = PyCFunction::new_closure(py, None, None, |arguments, _| {
        let running: Vec<Arc<RunThread>> = lock(&RUNNING).iter().filter_map(Weak::upgrade).collect();
        arguments.py().detach(|| running.iter().for_each(|runner| runner.park()));
    })?;
    py.import("atexit")?.call_method1("register", (park,))?;
    Ok(())
}

/// An event in the words of `palpate run --json`.
fn worded<'py>(py: Python<'py>, event: RunEvent, out: &Path) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let named = |name| dict.set_item("event", name);
    match event {
        RunEvent::Pressed(press) => press_into(&press, &dict)?,
        RunEvent::Ready(devices) => {
            named("ready")?;
            let about = |device: &Identity| {
                let Identity { role, identity, link, warnings } = device;
                [("role", role), ("identity", identity), ("link", link)].into_py_dict(py).and_then(|about| {
                    about.set_item("warnings", warnings)?;
                    Ok(about)
                })
            };
            dict.set_item("devices", devices.iter().map(about).collect::<PyResult<Vec<_>>>()?)?;
        }
        RunEvent::Begins { press, phase } => {
            named("begins")?;
            dict.set_item("press", press)?;
            dict.set_item("phase", phase.name())?;
        }
        RunEvent::Retouched(Retouch { place, before_mm, touched_mm, .. }) => {
            named("retouched")?;
            let values =
                [("x_mm", place.x_mm), ("y_mm", place.y_mm), ("before_mm", before_mm), ("touched_mm", touched_mm)];
            values.into_iter().try_for_each(|(name, value)| dict.set_item(name, value))?;
        }
        RunEvent::Rests { seconds } => {
            named("rests")?;
            dict.set_item("rest_s", seconds)?;
        }
        RunEvent::Ended(status) => {
            named("ended")?;
            dict.set_item("status", status.name())?;
            dict.set_item("out", out)?;
        }
    }
    Ok(dict)
}

/// Adds the columns of the press.
fn press_into(press: &Press, dict: &Bound<'_, PyDict>) -> PyResult<()> {
    for column in press.columns() {
        let (mut names, mut added) = (column.names(press.outputs.len()).into_iter(), Ok(()));
        column.write(press, &mut |value| {
            if let (Some(name), Ok(())) = (names.next(), &added) {
                added = match value {
                    CellValue::Count(count) => dict.set_item(name, count),
                    CellValue::Number(number) => dict.set_item(name, number),
                    CellValue::Text(text) => dict.set_item(name, text),
                    CellValue::Nothing => dict.set_item(name, None::<f64>),
                };
            }
        });
        added?;
    }
    Ok(())
}
