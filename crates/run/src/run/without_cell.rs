//! Execution of a plan on a rig without a load cell: presses by depth below a surface that the array felt, or that a person touched and
//! confirmed. `docs/decisions/control/without-a-load-cell.md` states what replaces the rules that need a force.

use super::again::MOVED_MOST_MM;
use super::clock::RunClock;
use super::execute::{Ending, RunJob, note_trip};
use super::home::at_home_without_cell;
use super::monitors::Monitors;
use super::past::Past;
use super::rig_control::AnyRigControl;
use super::unforced_motion::OutputsAtRest;
use super::window::OutputMeans;
use super::{Cancel, Halt, Listener, Remaining};
use crate::rig::{OpenRig, RigSpec};
use palpate_control::{ContactMap, Expected, LearnedContact, Permit, SafetyRule, SetPoint, Trip, Zero};
use palpate_core::quantity::{Place, seconds};
use palpate_data::dataset::{
    Flag, Ledger, Left, NoLoad, Press, PressTruth, Record, RecordedContact, RecordedSurface, SurfaceFinder,
};
use palpate_data::recipe::{Entry, Plan};
use palpate_link::device::{Identity, Stage as _};
use palpate_link::time::Instant;

/// Assumed time of an exchange with the stage, s. No motion is ended by it: each end point is safe by itself.
const EXCHANGE_S: f64 = 0.1;

/// Number of places where the array feels for the surface: a plane needs three, and the others check it.
const FELT_PLACES: usize = 5;

/// Largest part of the outputs of a press that may remain after the retraction: more shows that the contact continues.
const REMAINING_SHARE: f64 = 0.25;

/// Number of presses at the beginning of a run, none of which changes the outputs, after which the surface counts as not met.
const UNFELT_MOST: u32 = 5;

/// Reason why a run doesn't continue.
const CONFIRM_AGAIN: &str = "a person confirmed the surface when this run began: nothing was moved. Check that the sensor is still where it \
                             was, then add --confirmed touch";

/// Executes the plan. The stage is always parked at the end of z's travel.
pub(super) async fn execute_without_cell(mut rig: OpenRig, job: RunJob<'_>, listener: &mut dyn Listener) -> Ending {
    let RunJob { plan, spec, ledger, cancel, shown } = job;
    let past = match Past::of(ledger, plan, spec.frame.uncertainty_mm) {
        Ok(past) => past,
        Err(error) => return Ending::halted(error),
    };
    if !spec.is_touched && past.surfaces.iter().any(|surface| surface.by == SurfaceFinder::Person) {
        return Ending::halted(Halt::Unconfirmed(CONFIRM_AGAIN.to_owned()));
    }
    let clock = RunClock::going_on_from(past.elapsed_s);
    let (monitors, identities) = match Monitors::ready(&mut rig, spec, cancel).await {
        Ok(ready) => ready,
        Err(halt) => return Ending { t_s: clock.now_s(), ..Ending::halted(halt) },
    };
    let (rig_control, mut devices) = match at_home_without_cell(rig, spec, cancel, shown).await {
        Ok(ready) => ready,
        Err(halt) => return Ending { t_s: clock.now_s(), remaining: Remaining::NoLoadCell, ..Ending::halted(halt) },
    };
    devices.extend(identities);
    let permit = Permit::new(spec.limits, rig_control.usage.bounds(), EXCHANGE_S, &Zero::with_noise(0.0));
    let mut runner = DepthRunner {
        plan,
        spec,
        ledger,
        listener,
        rig_control,
        monitors,
        permit,
        map: ContactMap::new(spec.frame.uncertainty_mm),
        cancel,
        clock,
        pressing: None,
        before: None,
        unfelt: Some(0),
    };
    let mut ending = Ending::parked();
    ending.halt = runner.begin(&past, devices).await.err();
    let peaks = runner.rig_control.press_truth().map(PressTruth::peaks);
    note_trip(runner.ledger, &ending, runner.pressing, peaks, clock.now_s());
    ending.unparked = runner.rig_control.leave(ending.halt.as_ref(), spec.top_mm(), &spec.limits).await.err();
    if ending.halt.as_ref().is_some_and(Halt::is_fault) || ending.unparked.is_some() {
        ending.remaining = Remaining::NoLoadCell;
    }
    ending.t_s = clock.now_s();
    ending
}

/// Driver of a run without a load cell.
pub(super) struct DepthRunner<'a> {
    plan: &'a Plan,
    pub spec: &'a RigSpec,
    ledger: &'a mut dyn Ledger,
    listener: &'a mut dyn Listener,
    pub rig_control: AnyRigControl<'a>,
    monitors: Monitors,
    pub permit: Permit,
    /// The surface.
    pub map: ContactMap,
    cancel: &'a Cancel,
    clock: RunClock,
    /// Entry that is under way.
    pressing: Option<u64>,
    /// Outputs of the last press.
    before: Option<Vec<f64>>,
    /// Presses so far if none changed the outputs; `None` after one did.
    unfelt: Option<u32>,
}

impl DepthRunner<'_> {
    async fn begin(&mut self, past: &Past, devices: Vec<Identity>) -> Result<(), Halt> {
        self.cancel.prepared();
        self.listener.ready(&devices);
        past.check_devices(&devices)?;
        self.ledger.record(&Record::Devices(devices))?;
        let left: Vec<&Entry> = self.plan.entries.iter().filter(|entry| !self.ledger.has(entry.press)).collect();
        if left.is_empty() {
            return Ok(());
        }
        self.find_surface(past).await?;
        for (index, entry) in left.iter().enumerate() {
            self.pause_if_asked().await?;
            self.await_monitors().await?;
            self.pressing = Some(entry.press);
            self.listener.begins(entry);
            let contact = self.press(entry, left.get(index + 1).map(|next| next.place)).await?;
            let record = Record::Contact(contact);
            self.ledger.record(&record)?;
            self.pressing = None;
            record.contact().into_iter().for_each(|contact| self.listener.recorded(contact));
            if entry.rest_after_s > 0.0 {
                self.listener.rests(entry.rest_after_s);
                self.cancel.sleep(seconds(entry.rest_after_s)).await;
            }
        }
        Ok(())
    }

    /// Finds the surface from which depths count, and records it. A surface that an earlier session found must still be there.
    async fn find_surface(&mut self, past: &Past) -> Result<(), Halt> {
        if self.spec.is_touched {
            return self.note_surface(Place::default(), 0.0, SurfaceFinder::Person);
        }
        for place in self.felt_places() {
            self.cancel.check()?;
            let z_mm = self.feel_surface(place).await?;
            self.note_surface(place, z_mm, SurfaceFinder::Array)?;
            let is_known = |known: &&RecordedSurface| known.by == SurfaceFinder::Array && known.place == place;
            if let Some(known) = past.surfaces.iter().find(is_known) {
                let moved_mm = z_mm - known.z_mm;
                let is_there = moved_mm.abs() <= MOVED_MOST_MM; // written as the positive condition, so NaN fails
                if !is_there {
                    return Err(Trip::new(SafetyRule::SurfaceMoved, moved_mm, MOVED_MOST_MM, "mm").into());
                }
            }
            self.map.learn(&LearnedContact::Touch { place, z_mm, path: Vec::new() });
        }
        Ok(())
    }

    fn note_surface(&mut self, place: Place, z_mm: f64, by: SurfaceFinder) -> Result<(), Halt> {
        let t_s = self.clock.now_s();
        Ok(self.ledger.record(&Record::Surface(RecordedSurface { t_s, place, z_mm, by }))?)
    }

    /// Places of the plan that are as far from one another as possible.
    fn felt_places(&self) -> Vec<Place> {
        let places = || self.plan.entries.iter().map(|entry| entry.place);
        let mut chosen: Vec<Place> = places().take(1).collect();
        while chosen.len() < FELT_PLACES {
            let apart_mm =
                |place: &Place| chosen.iter().map(|other| other.distance_mm(*place)).fold(f64::INFINITY, f64::min);
            let farthest = places().max_by(|a, b| apart_mm(a).total_cmp(&apart_mm(b)));
            match farthest.filter(|place| apart_mm(place) > 0.0) {
                Some(place) => chosen.push(place),
                None => break,
            }
        }
        chosen
    }

    /// Makes one press, from the clear to the clear.
    async fn press(&mut self, entry: &Entry, next: Option<Place>) -> Result<RecordedContact, Halt> {
        let mut levels = Vec::with_capacity(entry.task.levels.len());
        let mut truth = Vec::new();
        self.go_to(entry.place).await?;
        self.rig_control.stage.forget_timing();
        self.rig_control.truth.begin_press(entry.press);
        let no_load_before = self.rig_control.outputs_at_rest().await?;
        let surface = self.map.expect(entry.place);
        let Expected { z_mm: surface_mm, first_mm, .. } = surface;
        for (level, set) in entry.task.levels.iter().enumerate() {
            let SetPoint::Depth(depth_mm) = set.set else {
                // the plan refuses a force
                return Err(Trip::new(SafetyRule::NotPermitted, set.set.force_n().unwrap_or(0.0), 0.0, "N").into());
            };
            let speed_mm_s = self.spec.stage.approach_mm_s;
            let granted = self.permit.advance_without_force(first_mm, surface_mm + depth_mm, speed_mm_s)?;
            self.rig_control.move_z_unforced(granted).await?;
            self.cancel.sleep(seconds(entry.task.hold_s)).await;
            self.cancel.check()?;
            let (row, pressed) = self.level(entry, level, &surface, &no_load_before).await?;
            truth.extend(self.rig_control.press_truth().map(PressTruth::rounded));
            self.before = Some(pressed);
            levels.push(row.rounded());
        }
        self.clear(first_mm).await?;
        let no_load_after = self.rig_control.outputs_at_rest().await?;
        self.check_contact_ended(&no_load_before, &no_load_after, levels.last())?;
        self.check_felt(&no_load_before, &levels)?;
        if let Some(next) = next {
            self.go_to(next).await?;
        }
        let no_load = |at_rest: OutputsAtRest| NoLoad { outputs: at_rest.means, ..NoLoad::default() };
        Ok(RecordedContact {
            press: entry.press,
            levels,
            truth,
            no_load_before: no_load(no_load_before),
            no_load_after: no_load(no_load_after),
            left: next.map(|_| Left { z_mm: self.rig_control.z_mm }),
            monitors: self.monitors.values(),
            ..RecordedContact::default()
        })
    }

    /// Samples a level. Returns its row, and its outputs.
    async fn level(
        &mut self,
        entry: &Entry,
        level: usize,
        surface: &Expected,
        no_load: &OutputsAtRest,
    ) -> Result<(Press, Vec<f64>), Halt> {
        let began = Instant::now();
        self.rig_control.truth.open_window();
        let range_v = self.spec.array.range_v;
        let sampled = self.rig_control.sample_outputs(entry.task.sample_s, range_v).await;
        self.rig_control.truth.close_window();
        let (OutputMeans { means, .. }, is_saturated) = sampled?;
        let outputs: Vec<f64> = means.iter().zip(&no_load.means).map(|(mean, no_load)| mean - no_load).collect();
        let depth_mm = self.rig_control.z_mm - surface.z_mm;
        // by the frame alone, a person vouches for the uncertainty
        let sigma_mm = if surface.touched { surface.sigma_mm } else { self.spec.frame.uncertainty_mm / 3f64.sqrt() };
        let set = entry.task.levels[level].set.depth_mm();
        let is_missed = set.is_none_or(|set_mm| (depth_mm - set_mm).abs() > entry.task.depth_tolerance_mm);
        let is_frozen = outputs.iter().all(|output| *output == 0.0) || self.before.as_ref() == Some(&outputs);
        let flags = [(Flag::OutOfTolerance, is_missed), (Flag::Saturated, is_saturated), (Flag::Stale, is_frozen)];
        let row = Press {
            press: entry.press,
            level: level as u64,
            phase: Some(entry.phase),
            x_mm: self.rig_control.pressed.x_mm,
            y_mm: self.rig_control.pressed.y_mm,
            depth_set_mm: set,
            depth_mm: Some(self.rig_control.frame.tilt.normal_mm(depth_mm)),
            u_depth_mm: self.spec.u_depth_mm(sigma_mm, 0.0),
            t_s: Some(self.clock.at_s(began)),
            outputs: outputs.clone(),
            flags: flags.into_iter().filter(|(_, is_so)| *is_so).map(|(flag, _)| flag).collect(),
            z_mm: Some(self.rig_control.frame.to_stage(entry.place, self.rig_control.z_mm).z_mm),
            ..Press::default()
        };
        Ok((row, outputs))
    }

    /// Checks by the outputs that the contact has ended: x and y may move then.
    fn check_contact_ended(
        &self,
        before: &OutputsAtRest,
        after: &OutputsAtRest,
        pressed: Option<&Press>,
    ) -> Result<(), Trip> {
        let pressed = pressed.map_or(0.0, |press| length(press.outputs.iter().copied()));
        let remaining = after.distance(&before.means);
        let most = (REMAINING_SHARE * pressed).max(before.noise_most());
        match remaining <= most {
            true => Ok(()),
            false => Err(Trip::new(SafetyRule::StillTouching, remaining, most, &self.spec.array.unit)),
        }
    }

    /// Checks that the first presses met the surface: presses in air would all be recorded, and none evaluated.
    fn check_felt(&mut self, before: &OutputsAtRest, levels: &[Press]) -> Result<(), Trip> {
        let Some(unfelt) = &mut self.unfelt else { return Ok(()) };
        let is_felt = |press: &Press| length(press.outputs.iter().copied()) > before.noise_most();
        if levels.iter().any(is_felt) {
            self.unfelt = None;
            return Ok(());
        }
        *unfelt += 1;
        let deepest_mm = levels.iter().filter_map(|press| press.depth_mm).fold(0.0, f64::max);
        match *unfelt < UNFELT_MOST {
            true => Ok(()),
            false => Err(Trip::new(SafetyRule::NoContact, deepest_mm, self.spec.frame.uncertainty_mm, "mm")),
        }
    }

    /// Moves to a place, after z has cleared the highest possible surface here and there.
    pub(super) async fn go_to(&mut self, place: Place) -> Result<(), Halt> {
        let first_mm = self.map.first_on_way_mm(self.rig_control.place, place);
        self.clear(first_mm).await?;
        self.rig_control.travel_unforced(place, &self.permit, first_mm).await
    }

    /// Moves z away until it clears a surface that is no earlier than this, mm.
    pub(super) async fn clear(&mut self, first_mm: f64) -> Result<(), Halt> {
        let (z_mm, clear_mm) = (self.rig_control.z_mm, self.permit.travel_mm(first_mm));
        if z_mm > clear_mm {
            let away = self.permit.retract(z_mm, clear_mm, self.rig_control.usage.speed_mm_s)?;
            self.rig_control.move_z_unforced(away).await?;
        }
        Ok(())
    }

    /// Reads the monitors without load, and rests until their values are within their bounds.
    async fn await_monitors(&mut self) -> Result<(), Halt> {
        while let Some(wait) = self.monitors.look(self.clock, self.listener).await? {
            self.cancel.sleep(wait).await;
            self.pause_if_asked().await?;
        }
        Ok(())
    }

    async fn pause_if_asked(&mut self) -> Result<(), Halt> {
        self.cancel.check()?;
        if !self.cancel.pausing() {
            return Ok(());
        }
        self.rig_control.retract(self.spec.top_mm()).await?;
        if !self.listener.paused() {
            return Err(Halt::Cancelled);
        }
        self.cancel.while_pausing().await;
        self.cancel.check()
    }
}

/// Length of a row of outputs.
pub(super) fn length(outputs: impl Iterator<Item = f64>) -> f64 {
    outputs.map(|output| output * output).sum::<f64>().sqrt()
}
