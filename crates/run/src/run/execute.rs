//! Execution of a plan on a rig.

use super::check_weight::{Ask, CellAfter, KnownWeight};
use super::checks::Checking;
use super::clock::RunClock;
use super::doubt::DOUBTED;
use super::last_resort::LAST_RESORT_SHARE;
use super::monitors::Monitors;
use super::past::{Past, felt};
use super::ready::{Conditions, Ready, make_ready, take_zero};
use super::rig_control::AnyRigControl;
use super::series::SeriesRecorder;
use super::without_cell::execute_without_cell;
use super::{Cancel, Halt, LargestForce, Remaining};
use crate::rig::{OpenRig, RigSpec};
use palpate_control::{
    ContactMap, DragResponses, Glitches, LearnedOutputs, MeasuredContact, NO_LOAD_READINGS, Permit, Reaction,
    SafetyRule, SetPoint, Trip,
};
use palpate_core::quantity::Place;
use palpate_data::dataset::{
    CalledSound, Flag, Ledger, Left, NoLoad, Peaks, PressTruth, Record, RecordedCheck, RecordedContact, Retouch,
    SessionEnd, Status,
};
use palpate_data::recipe::{Entry, Plan};
use palpate_link::device::Identity;
use palpate_link::time::Instant;
use std::collections::VecDeque;
use std::pin::Pin;
use std::time::Duration;

/// Drift of the zero since it was last completely determined, as a fraction of the force limit, above which it is determined
/// again. Then noise and mains interference are up to date too.
const NEW_ZERO_SHARE: f64 = 0.05;

/// Longest time that monitors may take after which the readings without load still count for the next press.
const NO_LOAD_FRESH: Duration = Duration::from_millis(50);

/// Task of a run: a plan on a rig, recorded in a ledger.
pub struct RunJob<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// The rig.
    pub spec: &'a RigSpec,
    /// Ledger that records the entries. Entries that are already in the ledger aren't repeated.
    pub ledger: &'a mut dyn Ledger,
    /// Requests of a person to pause or to stop.
    pub cancel: &'a Cancel,
    /// Called for every force, N, to show it to a person.
    pub shown: &'a dyn Fn(f64),
}

/// End of a run.
#[derive(Debug)]
pub struct Ending {
    /// Reason why the run ended early; `None` if the plan is complete.
    pub halt: Option<Halt>,
    /// Reason why the stage couldn't be parked, if there is one.
    pub unparked: Option<Halt>,
    /// Force on the specimen after the stage was parked.
    pub remaining: Remaining,
    /// Largest force that was read, if the run ended early and pressed.
    pub largest: Option<LargestForce>,
    /// Time of the end, s since the run's start.
    pub t_s: f64,
    /// Load cell after the run; `None` if no weight was put on.
    pub cell: Option<CellAfter>,
    /// Readings of the load cell that were left out as impossible.
    pub glitches: Glitches,
}

/// Receiver of information about events.
pub trait Listener {
    /// Reports that the instruments are ready, with their identities.
    fn ready(&mut self, _devices: &[Identity]) {}
    /// Reports that a place was touched again before the run continues.
    fn retouched(&mut self, _retouch: &Retouch) {}
    /// Reports that an entry of the plan begins.
    fn begins(&mut self, _entry: &Entry) {}
    /// Reports that a contact is on disk.
    fn recorded(&mut self, _contact: &RecordedContact) {}
    /// Reports that a check is on disk.
    fn checked(&mut self, _check: &RecordedCheck) {}
    /// Reports that the next press waits for a monitored value, in a sentence.
    fn waits(&mut self, _text: &str) {}
    /// Reports that the indenter rests without load for this time, s.
    fn rests(&mut self, _seconds: f64) {}
    /// Returns the weight that a person can put on the tip after the run; `None` if no person is there, or the weight isn't known.
    fn weight(&mut self) -> Option<KnownWeight> {
        None
    }
    /// Asks the person for that weight.
    fn ask(&mut self, _ask: Ask) {}
    /// Reports that the stage is parked between two presses, because the operator requested a pause. Returns whether someone can
    /// end the pause; if not, the run ends here.
    fn paused(&mut self) -> bool {
        false
    }
}

/// Makes every press of the plan that isn't recorded yet. The stage is always parked in the clear at the end.
pub async fn execute(job: RunJob<'_>, listener: &mut dyn Listener) -> Ending {
    match job.spec.open(job.plan.seed) {
        Ok(rig) => execute_on(rig, job, listener).await,
        Err(error) => Ending::halted(error),
    }
}

/// Does the same on a rig that is already open.
///
/// The future is boxed so that the library compiles it once. Code that is `async` is compiled again in each program that awaits
/// it.
pub fn execute_on<'w, 'e: 'w>(
    rig: OpenRig,
    job: RunJob<'e>,
    listener: &'w mut dyn Listener,
) -> Pin<Box<dyn Future<Output = Ending> + 'w>> {
    Box::pin(execute_from(rig, job, listener))
}

async fn execute_from(mut rig: OpenRig, job: RunJob<'_>, listener: &mut dyn Listener) -> Ending {
    if !job.spec.has_load_cell() {
        return execute_without_cell(rig, job, listener).await;
    }
    let RunJob { plan, spec, ledger, cancel, shown } = job;
    let past = match Past::of(ledger, plan, spec.frame.uncertainty_mm) {
        Ok(past) => past,
        Err(error) => return Ending::halted(error),
    };
    let clock = RunClock::going_on_from(past.elapsed_s);
    let conditions = Conditions { spec, cancel, shown, clock, first_zero_n: past.first_zero_n };
    let (monitors, identities) = match Monitors::ready(&mut rig, spec, cancel).await {
        Ok(ready) => ready,
        Err(halt) => return Ending { t_s: clock.now_s(), ..Ending::halted(halt) },
    };
    let mut ending = Ending::parked();
    match make_ready(rig, &conditions).await {
        Ok(Ready { mut rig_control, mut devices, reaction, zero }) => {
            devices.extend(identities);
            if let Some(queue) = ledger.series() {
                rig_control.record(SeriesRecorder::new(plan.series, queue, clock));
            }
            let permit = permit(&rig_control, spec, &reaction);
            let (map, response) = (
                ContactMap::new(spec.frame.uncertainty_mm),
                LearnedOutputs::new(spec.array.layout.pitch_mm(), spec.limits.force_n),
            );
            let full_zero_n = rig_control.cell.watch.zero().offset_n;
            let (pressing, standby, felt, zeroed) = (None, None, None, Instant::now());
            let mut runner = Runner {
                plan,
                ledger,
                listener,
                rig_control,
                monitors,
                permit,
                map,
                drag_responses: DragResponses::default(),
                response,
                called_sound: Vec::new(),
                doubt: None,
                doubts_over: Some(DOUBTED),
                reaction,
                conditions,
                pressing,
                standby,
                zeroed,
                full_zero_n,
                flagged: 0,
                felt,
                checks: Checking::default(),
            };
            ending.halt = match runner.begin(past, devices, &zero).await.err() {
                Some(Halt::Tripped(trip)) => Some(runner.rig_control.cell.real_cause(trip).await.into()),
                halt => halt,
            };
            ending.glitches = runner.rig_control.cell.glitches();
            // the stage was stopped before a trip was reported; a program that is killed while it parks has tripped all the same
            let peaks = runner.rig_control.press_truth().map(PressTruth::peaks);
            note_trip(runner.ledger, &ending, runner.pressing, peaks, clock.now_s());
            let is_fault = ending.halt.as_ref().is_some_and(Halt::is_fault);
            let park_mm = if is_fault { spec.top_mm() } else { runner.park_mm() };
            let pressed_n = runner.rig_control.largest().map_or(0.0, |largest| largest.force_n);
            let at_trip = runner.rig_control.cell.at_trip(ending.halt.as_ref());
            ending.unparked = runner.rig_control.leave(ending.halt.as_ref(), park_mm, &spec.limits).await.err();
            if let (Some(at_trip), None) = (at_trip, &ending.unparked)
                && let Some(trip) = runner.rig_control.cell.after_leaving(at_trip).await
            {
                ending.halt = Some(trip.into());
                note_trip(runner.ledger, &ending, runner.pressing, peaks, clock.now_s());
            }
            // nothing else tells of a force on the way to park, which is no part of a press
            let most_n = pressed_n.max(LAST_RESORT_SHARE * spec.limits.force_n);
            let over_n =
                runner.rig_control.largest().map(|largest| largest.force_n).filter(|force_n| *force_n > most_n);
            if let (None, Some(over_n)) = (&ending.halt, over_n) {
                ending.halt = Some(Trip::new(SafetyRule::OverForce, over_n, spec.limits.force_n, "N").into());
                note_trip(runner.ledger, &ending, None, None, clock.now_s());
            }
            if ending.halt.is_some() || ending.unparked.is_some() {
                let doubted = ending.unparked.as_ref().or(ending.halt.as_ref());
                ending.remaining = runner.rig_control.remaining(doubted).await;
                ending.largest = runner.rig_control.largest();
            } else {
                ending.cell = runner.weigh_after().await;
            }
        }
        Err(halt) => {
            // without a zero, the load cell's reading is no force
            if matches!(halt, Halt::Tripped(_)) {
                ending.remaining = Remaining::Unknown;
            }
            ending.halt = Some(halt);
            note_trip(ledger, &ending, None, None, clock.now_s());
        }
    }
    ending.t_s = clock.now_s();
    ending
}

impl Ending {
    /// Creates the ending of a run in which nothing has moved.
    pub fn halted(halt: impl Into<Halt>) -> Self {
        Ending { halt: Some(halt.into()), ..Ending::parked() }
    }

    /// Creates the ending of a run whose stage is parked without load.
    pub(super) fn parked() -> Self {
        Ending {
            halt: None,
            unparked: None,
            remaining: Remaining::Nothing,
            largest: None,
            t_s: 0.0,
            cell: None,
            glitches: Glitches::default(),
        }
    }

    /// Returns the status for the run's manifest.
    pub fn status(&self) -> Status {
        match (&self.halt, &self.unparked) {
            (None, None) => Status::Complete,
            (Some(Halt::Cancelled | Halt::OutOfBounds(_)), None) => Status::Stopped,
            (Some(Halt::Tripped(_)), _) => Status::Tripped,
            _ => Status::Failed,
        }
    }

    /// Returns the end of the run for its journal.
    pub fn end(&self, ended: String, wall_s: f64) -> SessionEnd {
        let (status, failure) = (self.status(), self.text());
        let cell_off = self.cell.as_ref().and_then(CellAfter::problem);
        let (t_s, glitches) = (self.t_s, self.glitches);
        SessionEnd { status, t_s, ended, wall_s, failure, cell_unchecked: false, cell_off, glitches, series: None }
    }

    /// Returns the problem in words; `None` if there was no problem or a person stopped the run.
    pub fn text(&self) -> Option<String> {
        let text = |halt: &Halt| match halt {
            Halt::Cancelled => None,
            Halt::Tripped(trip) => Some(trip.to_string()),
            Halt::Device(error) | Halt::Missed(error) => Some(error.to_string()),
            Halt::Record(error) => Some(error.to_string()),
            Halt::Unconfirmed(why) | Halt::OutOfBounds(why) => Some(why.clone()),
        };
        let unparked = self.unparked.as_ref().and_then(text).map(|why| format!("the stage could not be parked: {why}"));
        let parts = self.halt.as_ref().and_then(text).into_iter().chain(unparked).chain(self.remaining.text());
        let mut parts: Vec<String> = parts.collect();
        if parts.is_empty() {
            return None;
        }
        parts.extend(self.largest.as_ref().map(LargestForce::text));
        parts.extend(self.glitches.text());
        Some(parts.join("; "))
    }
}

/// Records a trip. If the record can't be stored any more, the trip is still reported.
pub(super) fn note_trip(ledger: &mut dyn Ledger, ending: &Ending, press: Option<u64>, peaks: Option<Peaks>, t_s: f64) {
    if let Some(Halt::Tripped(trip)) = &ending.halt {
        let _ = ledger.append_unsynced(&Record::Trip { t_s, press, trip: trip.clone(), peaks });
    }
}

fn permit(rig_control: &AnyRigControl<'_>, spec: &RigSpec, reaction: &Reaction) -> Permit {
    Permit::new(spec.limits, rig_control.usage.bounds(), reaction.worst_s(), rig_control.cell.watch.zero())
        .with_drags(spec.drag)
}

/// Position where the indenter waits for the next press.
pub(super) struct Standby {
    /// Position in the clear above the next place, specimen frame, mm.
    pub z_mm: f64,
    /// Readings without load on the way there; `None` if the reading without load may have changed since.
    pub no_load: Option<NoLoad>,
}

/// Driver of the run, which goes from press to press.
pub(super) struct Runner<'a> {
    pub plan: &'a Plan,
    pub ledger: &'a mut dyn Ledger,
    pub listener: &'a mut dyn Listener,
    pub rig_control: AnyRigControl<'a>,
    pub monitors: Monitors,
    pub permit: Permit,
    pub map: ContactMap,
    /// Forces sideways that the drags so far have shown.
    pub drag_responses: DragResponses,
    /// Outputs that the presses so far have shown.
    pub response: LearnedOutputs,
    pub reaction: Reaction,
    pub conditions: Conditions<'a>,
    /// Entry that is under way.
    pub pressing: Option<u64>,
    /// State after the last contact, if nothing has happened since.
    pub standby: Option<Standby>,
    /// Time of the readings without load that forces are relative to.
    pub zeroed: Instant,
    /// Load cell reading without load at the last complete measurement of the zero, N.
    pub full_zero_n: f64,
    /// Number of presses in a row whose readings were missed, and that were flagged.
    pub flagged: u32,
    /// Last contact in which the array was sampled: place, force, and outputs, V.
    pub felt: Option<((Place, SetPoint), Vec<f64>)>,
    /// Checks so far, and what they are compared with.
    pub checks: Checking,
    /// What a person called sound.
    pub called_sound: Vec<CalledSound>,
    /// Doubt about the force of the press under way.
    pub doubt: Option<Trip>,
    /// Ratio to the set force of the force at whose depth, by the stiffest press so far, a force is doubted; `None` where the load cell has
    /// just shown that it measures the force.
    pub doubts_over: Option<f64>,
}

impl Runner<'_> {
    /// Records the rig's devices, checks that they are those with which the run began, and executes the plan.
    async fn begin(&mut self, past: Past, devices: Vec<Identity>, zero: &Record) -> Result<(), Halt> {
        self.listener.ready(&devices);
        past.check_devices(&devices)?;
        self.ledger.record(&Record::Devices(devices))?;
        self.ledger.record(zero)?;
        let left: VecDeque<&Entry> = self.plan.entries.iter().filter(|entry| !self.ledger.has(entry.press)).collect();
        let first = left.front().map(|first| first.place);
        let Some(first) = first.or_else(|| past.checks.closing_place(self.plan)) else { return Ok(()) };
        self.touch_again(&past, first).await?;
        (self.map, self.checks, self.called_sound) = (past.map, past.checks, past.called_sound);
        past.felt.into_iter().for_each(|felt| self.response.learn(self.with_noise(felt)));
        let mut owed_s = 0.0;
        if let Some((last, how)) = past.last {
            // the elapsed part isn't known
            owed_s = self.plan.entries.iter().find(|entry| entry.press == last).map_or(0.0, |entry| entry.rest_after_s);
            if let Some(how) = how {
                self.go_back(first, how).await?;
            }
        }
        self.rest(owed_s, first).await?;
        self.presses(left).await?;
        self.check_at_end().await
    }

    /// Position where the stage is parked: at clearance height, or at the top before the specimen was touched.
    pub(super) fn park_mm(&self) -> f64 {
        let spec = self.conditions.spec;
        if self.map.is_touched() { spec.clear_mm() } else { spec.top_mm() }
    }

    /// Compares what the array felt with earlier presses. A contact that a person called sound is flagged instead of stopped.
    fn compare(&mut self, felt: MeasuredContact, contact: &mut RecordedContact) -> Result<(), Halt> {
        if let Err(trip) = self.response.check(&felt) {
            let covering = self.called_sound.iter().find(|sound| sound.covers(trip.rule, contact.press));
            let Some(sound) = covering else { return Err(trip.into()) };
            if !sound.from_here {
                contact.levels.iter_mut().for_each(|level| level.flags.push(Flag::CalledSound));
            }
        }
        self.response.learn(felt);
        Ok(())
    }

    async fn presses(&mut self, mut left: VecDeque<&Entry>) -> Result<(), Halt> {
        while let Some(entry) = left.pop_front() {
            self.await_monitors(entry.place).await?;
            self.check_before(entry).await?;
            self.pressing = Some(entry.press);
            self.listener.begins(entry);
            let next = left.front().map(|next| next.place);
            let mut contact = self.press_again_if_missed(entry, next).await?;
            contact.series = self.rig_control.series.as_ref().map(|series| series.end()).transpose()?;
            if let Some((felt, _)) = felt(&contact) {
                self.compare(self.with_noise(felt), &mut contact)?;
            }
            contact.learned_contact.iter().for_each(|learned_contact| self.map.learn(learned_contact));
            let drifted_n = contact.no_load_after.force.mean_n - self.full_zero_n;
            self.standby =
                contact.left.map(|Left { z_mm }| Standby { z_mm, no_load: Some(contact.no_load_after.clone()) });
            let record = Record::Contact(contact);
            self.ledger.record(&record)?;
            self.pressing = None;
            if let Some(contact) = record.contact() {
                self.checks.take_contact(contact);
                self.listener.recorded(contact);
            }
            let Some(next) = next else { break };
            if drifted_n.abs() > NEW_ZERO_SHARE * self.conditions.spec.limits.force_n {
                self.zero_again(next).await?;
            }
            self.rest(entry.rest_after_s, next).await?;
        }
        Ok(())
    }

    /// Reads the monitors without load, and rests until their values are within their bounds.
    async fn await_monitors(&mut self, next: Place) -> Result<(), Halt> {
        let began = Instant::now();
        while let Some(wait) = self.look_at_monitors().await? {
            self.rest(wait.as_secs_f64(), next).await?;
        }
        if began.elapsed() > NO_LOAD_FRESH {
            self.standby = self.standby.take().map(|standby| Standby { no_load: None, ..standby });
        }
        Ok(())
    }

    /// Adds the noise of the array and of the load cell to what was felt.
    pub(super) fn with_noise(&self, felt: MeasuredContact) -> MeasuredContact {
        let cell_n = self.rig_control.cell.watch.zero().sigma_mean_n(NO_LOAD_READINGS);
        MeasuredContact { sigmas: [self.rig_control.output_sigma(), cell_n], ..felt }
    }

    /// Parks the stage until the operator continues. Then takes a new zero and goes back to where the last contact ended.
    async fn pause(&mut self, next: Place) -> Result<(), Halt> {
        self.rig_control.retract(self.park_mm()).await?;
        if !self.listener.paused() {
            return Err(Halt::Cancelled);
        }
        self.conditions.cancel.while_pausing().await;
        self.conditions.cancel.check()?;
        self.zero_again(next).await
    }

    /// Takes a new zero, away from the specimen, and goes back to where the last contact ended.
    async fn zero_again(&mut self, next: Place) -> Result<(), Halt> {
        self.rig_control.retract(self.park_mm()).await?;
        let zero = self
            .again_if_missed(async |runner: &mut Runner<'_>| {
                take_zero(&mut runner.rig_control, &runner.conditions).await
            })
            .await?;
        self.permit = permit(&self.rig_control, self.conditions.spec, &self.reaction);
        (self.zeroed, self.full_zero_n) = (Instant::now(), self.rig_control.cell.watch.zero().offset_n);
        self.ledger.record(&zero)?;
        match self.standby.take() {
            Some(before) => self.go_back(next, before).await,
            None => Ok(()),
        }
    }

    /// Rests without load for this time, and pauses if the operator requests it. The rest continues during a pause and isn't shortened.
    pub(super) async fn rest(&mut self, seconds: f64, next: Place) -> Result<(), Halt> {
        let rested = Instant::now() + Duration::from_secs_f64(seconds);
        loop {
            let rest = rested.duration_since(Instant::now());
            if !rest.is_zero() {
                self.standby = self.standby.take().map(|standby| Standby { no_load: None, ..standby });
                self.listener.rests(rest.as_secs_f64());
                self.conditions.cancel.sleep(rest).await;
            }
            self.conditions.cancel.check()?;
            if self.conditions.cancel.pausing() {
                self.pause(next).await?;
            } else if Instant::now() >= rested {
                return Ok(());
            }
        }
    }
}
