use super::clock::RunClock;
use super::hand::Hand;
use super::ready::{Conditions, Ready, make_ready};
use super::window::Window;
use super::{Cancel, Halt};
use crate::control::{Command, Context, Event, Map, Moment, Permit, Press, Strategy};
use crate::dataset::{Contact, Flag, Ledger, Record, Row, RowTruth, Status};
use crate::device::{LoadCell, SensorArray, Stage};
use crate::quantity::{Limits, Place};
use crate::recipe::{Entry, Plan};
use crate::rig::{OpenRig, RigSpec};
use std::collections::VecDeque;
use std::time::Duration;

/// Clearance above the learned surface in which the indenter travels from place to place, mm.
const TRAVEL_CLEARANCE_MM: f64 = 0.10;

/// Noise of one reading that the controller's guard leaves room for: it looks at each by itself, thousands a press.
const GUARD_SIGMAS: f64 = 8.0;

/// What is to be done: a plan on a rig, recorded in a ledger.
pub struct Errand<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// The rig.
    pub spec: &'a RigSpec,
    /// Where it is recorded. Entries that are there already aren't made again.
    pub ledger: &'a mut dyn Ledger,
    /// A person's word to stop.
    pub cancel: &'a Cancel,
    /// Told of every force, N, for a person to see.
    pub shown: &'a dyn Fn(f64),
}

/// How a walk ended.
#[derive(Debug)]
pub struct Ending {
    /// Why it ended early; none: the plan is done.
    pub halt: Option<Halt>,
    /// Why the stage couldn't be parked, if it couldn't.
    pub unparked: Option<Halt>,
}

/// Who is told what happens.
pub trait Listener {
    /// The instruments are ready: what they said they are.
    fn ready(&mut self, _devices: &[crate::device::Identity]) {}
    /// An entry of the plan begins.
    fn begins(&mut self, _entry: &Entry) {}
    /// A contact is on disk.
    fn recorded(&mut self, _contact: &Contact) {}
    /// The indenter rests in air for so long, s.
    fn rests(&mut self, _seconds: f64) {}
}

/// Makes every press of the plan that isn't recorded yet. However it ends, the stage is parked in the clear.
pub async fn walk(errand: Errand<'_>, listener: &mut dyn Listener) -> Ending {
    match errand.spec.open(errand.plan.seed) {
        Ok(rig) => walk_on(rig, errand, listener).await,
        Err(error) => Ending { halt: Some(error.into()), unparked: None },
    }
}

/// The same on a rig that is open already.
pub async fn walk_on(rig: OpenRig, errand: Errand<'_>, listener: &mut dyn Listener) -> Ending {
    let Errand { plan, spec, ledger, cancel, shown } = errand;
    let clock = RunClock::going_on_from(ledger.elapsed_s());
    let conditions = Conditions { spec, cancel, shown, clock, first_zero_n: ledger.first_zero_n() };
    let mut ending = Ending { halt: None, unparked: None };
    let ready = make_ready(rig, &conditions).await;
    match ready {
        Ok(Ready { hand, devices, reaction, zero }) => {
            listener.ready(&devices);
            let begun = ledger.note_devices(&devices);
            let permit =
                Permit::new(spec.limits, reaction.worst_s(), hand.usage.acceleration_mm_s2, hand.cell.watch.zero());
            let map = Map::new(spec.frame.uncertainty_mm);
            let mut walker = Walker { hand, permit, map, limits: spec.limits, clock, pressing: None };
            let recorded = begun.and_then(|()| ledger.record(&zero)).map_err(Halt::from);
            ending.halt = match recorded {
                Ok(()) => walker.presses(plan, ledger, listener).await.err(),
                Err(halt) => Some(halt),
            };
            ending.unparked = walker.hand.withdraw(spec.clear_mm()).await.err();
            note_trip(ledger, &ending, walker.pressing, clock.now_s());
        }
        Err(halt) => {
            ending.halt = Some(halt);
            note_trip(ledger, &ending, None, clock.now_s());
        }
    }
    ledger.note_elapsed(clock.now_s());
    ending
}

impl Ending {
    /// The status that the run's manifest is to have.
    pub fn status(&self) -> Status {
        match (&self.halt, &self.unparked) {
            (None, None) => Status::Complete,
            (Some(Halt::Cancelled), None) => Status::Stopped,
            (Some(Halt::Tripped(_)), _) => Status::Tripped,
            _ => Status::Failed,
        }
    }

    /// What went wrong, in words; none where nothing did, or where a person stopped it.
    pub fn told(&self) -> Option<String> {
        let told = |halt: &Halt| match halt {
            Halt::Cancelled => None,
            Halt::Tripped(trip) => Some(trip.to_string()),
            Halt::Device(error) => Some(error.to_string()),
            Halt::Record(error) => Some(error.to_string()),
        };
        let unparked = self.unparked.as_ref().and_then(told).map(|why| format!("the stage could not be parked: {why}"));
        let parts: Vec<String> = self.halt.as_ref().and_then(told).into_iter().chain(unparked).collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// A trip is recorded. A record that can't be kept any more doesn't hide it.
fn note_trip(ledger: &mut dyn Ledger, ending: &Ending, press: Option<u64>, t_s: f64) {
    if let Some(Halt::Tripped(trip)) = &ending.halt {
        let _ = ledger.record(&Record::Trip { t_s, press, trip: trip.clone() });
    }
}

struct Walker<'a, S, C, A> {
    hand: Hand<'a, S, C, A>,
    permit: Permit,
    map: Map,
    limits: Limits,
    clock: RunClock,
    pressing: Option<u64>,
}

impl<S: Stage, C: LoadCell, A: SensorArray> Walker<'_, S, C, A> {
    async fn presses(&mut self, plan: &Plan, ledger: &mut dyn Ledger, listener: &mut dyn Listener) -> Result<(), Halt> {
        let mut left: VecDeque<&Entry> = plan.entries.iter().filter(|entry| !ledger.has(entry.press)).collect();
        while let Some(entry) = left.pop_front() {
            let next = left.front().map_or(entry.place, |next| next.place);
            self.pressing = Some(entry.press);
            listener.begins(entry);
            let contact = self.press(entry, next).await?;
            contact.lesson.iter().for_each(|lesson| self.map.learn(lesson));
            let record = Record::Contact(contact);
            ledger.record(&record)?;
            self.pressing = None;
            record.contact().into_iter().for_each(|contact| listener.recorded(contact));
            if entry.rest_after_s > 0.0 && !left.is_empty() {
                listener.rests(entry.rest_after_s);
                self.hand.cell.watch.pause();
                self.hand.cell.cancel.sleep(Duration::from_secs_f64(entry.rest_after_s)).await;
                if self.hand.cell.cancel.asked() {
                    return Err(Halt::Cancelled);
                }
                self.hand.cell.open_air(); // what was read before the rest is old
            }
        }
        Ok(())
    }

    /// One contact, from the clear to the clear.
    async fn press(&mut self, entry: &Entry, next: Place) -> Result<Contact, Halt> {
        if let Some(probe) = &self.hand.probe {
            probe.begin_press(entry.press);
        }
        let first_mm = self.first_mm(self.hand.place, entry.place);
        self.hand.travel(entry.place, &self.permit, first_mm).await?;
        self.hand.stage.guard(Some(self.guard_n())).await?; // some exchanges, in which no force is read
        self.hand.cell.watch.pause();
        let air = self.hand.cell.close_air().await?;
        let first_mm = self.first_mm(entry.place, next);
        let mut press = Press::new(entry.task.clone(), self.context(entry, first_mm));
        let mut levels: Vec<Held> = Vec::with_capacity(entry.task.levels.len());
        let mut event = Event::Begin { z_mm: self.hand.z_mm, air };
        loop {
            let moment = Moment { now_s: self.hand.cell.now_s(), age_s: self.hand.cell.age_s() };
            event = match press.next(event, moment) {
                Command::Average(readings) => Event::Averaged { force_n: self.hand.cell.mean_n(readings).await? },
                Command::Move(granted) => {
                    self.hand.move_z(granted, Some(&mut press)).await?;
                    Event::Moved { z_mm: self.hand.z_mm }
                }
                Command::Depart(granted) => {
                    self.hand.depart(granted, next, &self.permit, first_mm).await?;
                    Event::Moved { z_mm: self.hand.z_mm }
                }
                Command::Dwell(seconds) => {
                    self.hand.cell.dwell(seconds).await?;
                    Event::Dwelt
                }
                Command::Sample(seconds) => {
                    let window = self.hand.sample(seconds).await?;
                    let force_n = window.force_n;
                    levels.push(Held { window, z_mm: self.hand.z_mm, truth: self.truth() });
                    Event::Sampled { force_n }
                }
                Command::Done => break,
                Command::Trip(trip) => return Err(trip.into()),
            };
        }
        self.hand.stage.guard(None).await?;
        if let (Some(last), Some(after)) = (levels.last_mut().and_then(|held| held.truth.as_mut()), self.truth()) {
            last.force_peak_n = last.force_peak_n.max(after.force_peak_n);
            last.depth_peak_mm = last.depth_peak_mm.max(after.depth_peak_mm);
        }
        let touched_mm = press.touched_mm();
        let rows = levels.iter().enumerate().map(|(level, held)| self.row(entry, level, held, touched_mm)).collect();
        let truth = levels.iter().filter_map(|held| held.truth.map(RowTruth::rounded)).collect();
        Ok(Contact { press: entry.press, rows, truth, lesson: press.lesson() })
    }

    /// The reading at which the controller's own guard ends a motion: a little over what the watch trips at, N.
    fn guard_n(&self) -> f64 {
        let zero = self.hand.cell.watch.zero();
        zero.offset_n + self.limits.force_n + GUARD_SIGMAS * zero.sigma_n
    }

    fn context(&self, entry: &Entry, first_mm: f64) -> Context {
        let force_set_n = entry.task.most_n();
        let asks = entry.task.strategy == Strategy::Map && entry.task.levels.len() == 1;
        Context {
            place: entry.place,
            limits: self.limits,
            permit: self.permit,
            zero: *self.hand.cell.watch.zero(),
            expected: self.map.expect(entry.place),
            shot: asks.then(|| self.map.shot(entry.place, force_set_n, &self.limits)).flatten(),
            clear_mm: first_mm - TRAVEL_CLEARANCE_MM,
            speed_mm_s: self.hand.usage.speed_mm_s,
            timing: self.hand.timing,
        }
    }

    /// The earliest z at which there can be contact at either of two places, mm.
    fn first_mm(&self, here: Place, there: Place) -> f64 {
        self.map.expect(here).first_mm.min(self.map.expect(there).first_mm)
    }

    fn row(&self, entry: &Entry, level: usize, held: &Held, touched_mm: Option<f64>) -> Row {
        let Held { window, z_mm, .. } = held;
        let force_set_n = entry.task.levels[level].force_set_n;
        let missed = (window.force_n - force_set_n).abs() > entry.task.force_tolerance_n;
        let in_contact = force_set_n > 0.0;
        Row {
            press: entry.press,
            level: level as u64,
            phase: entry.phase,
            x_mm: entry.place.x_mm,
            y_mm: entry.place.y_mm,
            force_set_n,
            force_n: window.force_n,
            depth_mm: touched_mm.filter(|_| in_contact).map_or(0.0, |touched_mm| z_mm - touched_mm),
            t_s: self.clock.at_s(window.began),
            outputs: window.outputs.clone(),
            flags: if missed { vec![Flag::OutOfTolerance] } else { Vec::new() },
            z_mm: self.hand.frame.to_stage(entry.place, *z_mm).z_mm,
        }
        .rounded()
    }

    fn truth(&self) -> Option<RowTruth> {
        let truth = self.hand.probe.as_ref()?.take_truth();
        Some(RowTruth {
            force_true_n: truth.force_true_n,
            force_peak_n: truth.force_peak_n,
            depth_peak_mm: truth.depth_peak_mm,
        })
    }
}

/// One level as it was held.
struct Held {
    window: Window,
    z_mm: f64,
    truth: Option<RowTruth>,
}
