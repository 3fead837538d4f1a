//! Runs: begins one, resumes one, and executes its plan.

use super::choices::{DurabilityChoice, EvaluateChoice, SoundRule};
use super::labels::LabelOptions;
use super::provenance::{now, session};
use super::recorded::rig_of;
use super::results::RunResults;
use super::sources::{RigOptions, Sources, positive, read_rig_text};
use super::which_rig::ChosenRig;
use super::which_way::ConfirmOptions;
use super::{Failure, Note};
use miette::IntoDiagnostic;
use palpate_data::dataset::{
    CalledSound, DatasetError, Ledger, Provenance, Record, RigChange, RunFacts, RunFolder, SessionEnd, Status, Texts,
    files,
};
use palpate_data::recipe::{Plan, Recipe, SeriesScope};
use palpate_document::TEXT_MAX_BYTES;
use palpate_link::time::{run_virtually, spawn};
use palpate_run::rig::{Consequence, Difference, RigSpec, differences};
use palpate_run::run::{Cancel, Ending, Halt, Listener, RunJob, execute, keep_pace};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tokio::runtime::Builder;

/// A run: its recipe, its rig, and where it is recorded.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RunOptions {
    /// The recipe
    pub recipe: PathBuf,
    /// The rig, and what replaces the recipe's own values.
    #[command(flatten)]
    pub rig: RigOptions,
    /// Labels of the run.
    #[command(flatten)]
    pub labels: LabelOptions,
    /// Output folder [default: runs/NAME, runs/NAME-2, ...]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// How the rig is driven and its data are kept.
    #[command(flatten)]
    pub manner: MannerOptions,
}

/// A run that is continued.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ResumeOptions {
    /// The run folder
    pub run: PathBuf,
    /// Continue with this rig: links and commands of processes may differ, limits may be tighter
    #[arg(long, value_name = "RIG")]
    pub rig: Option<PathBuf>,
    /// Continue after a safety trip, once you have found its cause
    #[arg(long)]
    pub after_trip: bool,
    /// Repeat and flag a press that this rule stopped falsely
    #[arg(long, value_name = "RULE", conflicts_with = "after_trip")]
    pub sound: Option<SoundRule>,
    /// With --sound: compare no later press
    #[arg(long, requires = "sound")]
    pub from_here: bool,
    /// How the rig is driven and its data are kept.
    #[command(flatten)]
    pub manner: MannerOptions,
}

/// How a rig is driven and its data are kept.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct MannerOptions {
    /// Run a simulation at X times real time instead of as fast as possible
    #[arg(long, value_name = "X", value_parser = positive)]
    pub pace: Option<f64>,
    /// How safely presses are stored: full survives a power failure, fast only the end of palpate
    #[arg(long, value_name = "NAME", value_enum, default_value_t)]
    pub durability: DurabilityChoice,
    /// What a person has made sure of.
    #[command(flatten)]
    pub confirm: ConfirmOptions,
}

/// A run whose folder is made or open. Nothing has moved.
pub struct OpenedRun {
    pub(crate) recipe: Recipe,
    pub(crate) rig: RigSpec,
    pub(crate) plan: Plan,
    pub(crate) folder: RunFolder,
    pub(crate) pace: Option<f64>,
}

/// What [`resume`] found.
pub enum Resumed {
    /// The run continues.
    Begun(Box<OpenedRun>),
    /// The run is complete.
    Complete {
        /// Number of its presses.
        planned: usize,
        /// Whether its tables were missing and were regenerated.
        is_rebuilt: bool,
    },
}

/// Agrees to a rig before it moves, or refuses.
pub(crate) type Agree<'a> = &'a dyn Fn(&ChosenRig, &RigSpec) -> Result<(), Failure>;

/// Makes the folder of a run, like `palpate run`. A real rig must be named by [`RigOptions::rig`].
///
/// # Errors
/// Bad input, or the folder can't be made.
pub fn begin(options: &RunOptions) -> Result<OpenedRun, Failure> {
    let begun = begin_with(options, &agree_if_named)?;
    Ok(OpenedRun { rig: options.manner.confirm.of(begun.rig), ..begun })
}

/// Opens the folder of a run that was stopped, like `palpate resume`. Notes what differs from the rig with which the run began.
///
/// # Errors
/// Bad input, a run that ended with a safety trip, or a folder that can't be opened.
pub fn resume(options: &ResumeOptions, note: Note<'_>) -> Result<Resumed, Failure> {
    Ok(match resume_with(options, &|_, _| Ok(()), note)? {
        Resumed::Begun(mut begun) => {
            begun.rig = options.manner.confirm.of(begun.rig);
            Resumed::Begun(begun)
        }
        complete => complete,
    })
}

/// Makes all presses of a run, evaluates and judges it by its own recipe: [`begin`], [`OpenedRun::execute`] and [`OpenedRun::results`] in
/// one.
///
/// # Errors
/// Bad input, a device, a safety rule or the record.
pub fn run(options: &RunOptions, listener: &mut dyn Listener) -> Result<(PathBuf, RunResults), Failure> {
    let mut begun = begin(options)?;
    begun.execute(&Cancel::default(), &|_| {}, listener)?;
    Ok((begun.path().to_owned(), begun.results(EvaluateChoice::Best)?))
}

fn agree_if_named(chosen: &ChosenRig, rig: &RigSpec) -> Result<(), Failure> {
    if chosen.is_to_confirm(rig) { Err(chosen.unconfirmed()) } else { Ok(()) }
}

/// Makes the folder of a run, once the rig is agreed to.
pub(crate) fn begin_with(options: &RunOptions, agree: Agree<'_>) -> Result<OpenedRun, Failure> {
    options.check()?;
    let labels = &options.labels;
    if options.manner.confirm.is_touched() && (labels.sensor.is_none() || labels.mounting.is_none()) {
        let help = "a touch is confirmed for one sensor in one mounting: add --sensor ID and --mounting NAME";
        return Err(Failure::usage(miette::miette!(help = help, "--confirmed touch needs --sensor and --mounting")));
    }
    let Sources { recipe, mut rig, chosen, origins } = Sources::read(&options.recipe, &options.rig)?;
    rig.is_touched = options.manner.confirm.is_touched();
    let plan = Plan::new(&recipe, &rig.ground(), options.rig.seed).map_err(Failure::usage)?;
    options.manner.check(&rig)?;
    agree(&chosen, &rig)?;
    let facts = RunFacts {
        labels: options.labels.labels(),
        strategy: options.rig.strategy,
        presses_max: options.rig.presses_max,
        without_load_cell: !rig.has_load_cell(),
        three_axes: rig.has_three_axes(),
        confirmed_within_mm: rig.is_touched.then_some(rig.frame.uncertainty_mm),
        ..RunFacts::new(&plan, rig.is_simulated())
    };
    let session = session(options.manner.durability.into());
    let folder = RunFolder::create(options.out.as_deref(), &origins, facts, session, &rig.array.layout);
    Ok(OpenedRun { recipe, plan, folder: folder.map_err(Failure::unmade)?, rig, pace: options.manner.pace })
}

/// Opens the folder of a run that was stopped, once the rig is agreed to.
pub(crate) fn resume_with(options: &ResumeOptions, agree: Agree<'_>, note: Note<'_>) -> Result<Resumed, Failure> {
    let run = options.run.as_path();
    let (manifest, texts) = Texts::read(run).map_err(Failure::dataset)?;
    let facts = manifest.facts;
    let rig_path = options.rig.clone().unwrap_or_else(|| run.join("rig.toml"));
    let rig = RigOptions {
        rig: options.rig.clone(),
        simulate: facts.simulated,
        seed: facts.seed,
        strategy: facts.strategy,
        presses_max: facts.presses_max,
    };
    if facts.imported.is_some() {
        let help = "an imported run is complete: `palpate import` makes a new one";
        return Err(Failure::usage(miette::miette!(help = help, "{} was imported, not measured", run.display())));
    }
    rig_of(run, &texts)?; // reports best that the journal has lost its beginning
    let rig_text = rig_text(options, &texts)?;
    let changes = changes(&rig_path, &texts, &rig_text)?;
    let mut sources = Sources::of_run(run, &texts, &rig, ChosenRig::of_run(rig_path, rig_text.clone()), note)?;
    sources.rig.scene.specimen = facts.specimen;
    sources.rig.is_touched = options.manner.confirm.is_touched();
    let plan = sources.plan(facts.seed)?;
    options.manner.check(&sources.rig)?;
    let mut folder = RunFolder::open(run, &sources.rig.array.layout).map_err(Failure::dataset)?;
    let sound = options.sound.map(|rule| called_sound(rule, options.from_here, &folder)).transpose()?;
    if folder.manifest().status == Status::Tripped && !options.after_trip && sound.is_none() {
        let trip = folder.manifest().trip.as_ref().map(|trip| trip.to_string()).unwrap_or_default();
        let help = "find the cause; then add --after-trip";
        return Err(Failure::usage(miette::miette!(help = help, "the run ended with a safety trip: {trip}")));
    }
    if folder.manifest().status == Status::Complete {
        let is_rebuilt = !folder.is_finished().map_err(Failure::dataset)?;
        if is_rebuilt {
            folder.rebuild().map_err(Failure::dataset)?;
        }
        let planned = plan.entries.len();
        return Ok(Resumed::Complete { planned, is_rebuilt });
    }
    let Sources { recipe, rig, chosen, .. } = sources;
    agree(&chosen, &rig)?;
    for RigChange { key, before, now } in &changes {
        note(&format!("rig: `{key}` is {now} (it was {before} when the run began)"));
    }
    sound.iter().for_each(|sound| note(&sound.line()));
    let session = Provenance { changes, sound, ..session(options.manner.durability.into()) };
    folder.go_on(session, &rig_text).map_err(Failure::dataset)?;
    Ok(Resumed::Begun(Box::new(OpenedRun { recipe, rig, plan, folder, pace: options.manner.pace })))
}

/// Returns what a person calls sound: the press at which the rule ended the run.
fn called_sound(rule: SoundRule, from_here: bool, folder: &RunFolder) -> Result<CalledSound, Failure> {
    let mut last = None;
    let note_trip = &mut |record: &Record| {
        if let Record::Trip { trip, press, .. } = record {
            last = press.map(|press| (trip.rule, press));
        }
    };
    folder.recall(note_trip).map_err(Failure::dataset)?;
    let rule = rule.rule();
    match (folder.manifest().status, last) {
        (Status::Tripped, Some((by, press))) if by == rule => Ok(CalledSound { rule, press, from_here }),
        (status, _) => {
            let trip = folder.manifest().trip.as_ref().map(|trip| format!(": {trip}")).unwrap_or_default();
            let text = format!("no press was stopped by {}; the run is {}{trip}", rule.name(), status.name());
            Err(Failure::usage(miette::miette!(help = "call only sound what that rule stopped", "{text}")))
        }
    }
}

impl RunOptions {
    /// Checks what the types of the options allow but a run doesn't.
    fn check(&self) -> Result<(), Failure> {
        self.labels.check()?;
        self.rig.check()
    }
}

impl MannerOptions {
    /// Checks that they fit a rig, and that its load cell can be trusted, before anything is made.
    pub(crate) fn check(&self, spec: &RigSpec) -> Result<(), Failure> {
        match self.pace {
            Some(_) if !spec.is_simulated() => {
                return Err(Failure::usage(miette::miette!("--pace is only for simulated rigs")));
            }
            Some(pace) => _ = positive(&pace.to_string()).map_err(|why| Failure::option("--pace", pace, &why))?,
            None => {}
        }
        check_gain(spec)
    }
}

/// Checks that a rig's load cell can be trusted.
pub(crate) fn check_gain(spec: &RigSpec) -> Result<(), Failure> {
    spec.load_cell.check_gain().map_err(|trip| Failure::halted(trip.into()))
}

impl OpenedRun {
    /// Returns the folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Returns the number of presses of the plan.
    pub fn planned(&self) -> usize {
        self.plan.entries.len()
    }

    /// Makes the remaining presses, and parks the stage. `shown` is called for every force, N, and `listener` for every event.
    /// Returns the status: complete, or stopped if `cancel` requested it.
    ///
    /// # Errors
    /// A device failed, a safety rule was broken, or the record couldn't be stored.
    pub fn execute(
        &mut self,
        cancel: &Cancel,
        shown: &dyn Fn(f64),
        listener: &mut dyn Listener,
    ) -> Result<Status, Failure> {
        let OpenedRun { plan, rig, folder, pace, .. } = self;
        let (ending, finished) = executed(plan, rig, folder, *pace, cancel, (shown, listener))?;
        let status = ending.status();
        match ending {
            Ending { halt: None | Some(Halt::Cancelled), unparked: None, .. } => {
                finished.map_err(Failure::unfinished)?;
                Ok(status)
            }
            ending => Err(Failure::ended(ending)),
        }
    }

    /// Evaluates a complete run, and judges it by its own recipe.
    ///
    /// # Errors
    /// The record can't be read, or its measurements can't be evaluated.
    pub fn results(&self, methods: EvaluateChoice) -> Result<RunResults, Failure> {
        RunResults::of(&self.folder, &self.rig, &self.recipe, methods)
    }
}

/// Executes the rest of a plan, and ends the folder's session. Returns the end of the run, and whether it was recorded.
/// `heard` is called for every force, N, and for every event.
pub(crate) fn executed(
    plan: &Plan,
    spec: &RigSpec,
    folder: &mut RunFolder,
    pace: Option<f64>,
    cancel: &Cancel,
    heard: (&dyn Fn(f64), &mut dyn Listener),
) -> Result<(Ending, Result<(), DatasetError>), Failure> {
    let began = Instant::now();
    if plan.series != SeriesScope::None {
        let monitors: Vec<&str> = spec.monitors.iter().map(|monitor| monitor.name.as_str()).collect();
        folder.keep_series(&spec.array.unit, &monitors).map_err(Failure::dataset)?;
    }
    let ending = block_on(spec.is_simulated(), async {
        if let Some(pace) = pace {
            drop(spawn(keep_pace(pace)));
        }
        let (shown, listener) = heard;
        execute(RunJob { plan, spec, ledger: folder, cancel, shown }, listener).await
    })?;
    let cell_unchecked = spec.load_cell.check.is_some() && ending.cell.is_none() && ending.status() == Status::Complete;
    let finished = folder.finish(SessionEnd { cell_unchecked, ..ending.end(now(), began.elapsed().as_secs_f64()) });
    Ok((ending, finished))
}

/// Executes what a rig's drivers do: in virtual time with a simulated rig, else in real time.
pub(crate) fn block_on<T>(virtual_time: bool, work: impl Future<Output = T>) -> Result<T, Failure> {
    if virtual_time {
        return Ok(run_virtually(work));
    }
    let runtime = Builder::new_current_thread().enable_all().build().into_diagnostic().map_err(Failure::usage)?;
    Ok(runtime.block_on(work))
}

/// Returns the text of the rig to continue with: the named one, that of the folder, or the one stored in the journal.
fn rig_text(options: &ResumeOptions, texts: &Texts) -> Result<String, Failure> {
    if let Some(rig) = &options.rig {
        return read_rig_text(rig);
    }
    let path = options.run.join("rig.toml");
    match files::read_text(&path, TEXT_MAX_BYTES as u64) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(texts.rig().to_owned()),
        Err(error) => Err(Failure::usage(miette::miette!("{}: {error}", path.display()))),
        Ok(text) => Ok(text),
    }
}

/// Returns the differences from the rig with which the run began. Links, commands and tighter limits may differ. Any other
/// difference is refused, with its name.
fn changes(path: &Path, texts: &Texts, now: &str) -> Result<Vec<RigChange>, Failure> {
    let found = differences(texts.first_rig(), now).map_err(Failure::usage)?;
    let (refused, allowed): (Vec<Difference>, Vec<Difference>) =
        found.into_iter().partition(|difference| difference.verdict == Consequence::Other);
    if refused.is_empty() {
        return Ok(allowed.into_iter().map(|d| RigChange { key: d.path, before: d.before, now: d.now }).collect());
    }
    let each = |d: &Difference| format!("\n  `{}` is {}; the run began with {}", d.path, d.now, d.before);
    let each: String = refused.iter().map(each).collect();
    let help = "restore the values, or start a new run: only links, commands of processes and tighter limits may \
                change";
    Err(Failure::usage(miette::miette!(help = help, "{} isn't the rig that the run began with:{each}", path.display())))
}
