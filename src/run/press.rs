//! One press carried out.

use super::Halt;
use super::walk::Walker;
use super::window::Window;
use crate::control::{AirReadings, Command, Context, Event, ForceLoop, Lesson, Moment, Strategy, Task};
use crate::dataset::{self, Contact, Flag, Left, PressTruth};
use crate::device::{LoadCell, SensorArray, Stage};
use crate::quantity::Place;
use crate::recipe::Entry;

/// Clearance above the learned surface in which the indenter travels from place to place, mm.
pub(super) const TRAVEL_CLEARANCE_MM: f64 = 0.10;

/// Noise of one reading that the controller's guard leaves room for: it looks at each by itself, thousands a press.
const GUARD_SIGMAS: f64 = 8.0;

/// A contact that is over.
pub(super) struct Pressed {
    levels: Vec<Held>,
    air_n: f64,
    pub touched_mm: Option<f64>,
    lesson: Option<Lesson>,
}

/// One level as it was held.
struct Held {
    window: Window,
    z_mm: f64,
    truth: Option<PressTruth>,
}

impl<S: Stage, C: LoadCell, A: SensorArray> Walker<'_, S, C, A> {
    /// One entry of the plan, from the clear to the clear above the next place, of which it is told.
    pub async fn press(&mut self, entry: &Entry, next: Option<Place>) -> Result<Contact, Halt> {
        let pressed = self.contact(entry.press, entry.place, &entry.task, next.unwrap_or(entry.place)).await?;
        if let Some(next) = next {
            self.go_to(next).await?; // a staircase that ended in air is still where it was
        }
        let rests = entry.rest_after_s > 0.0;
        // what the cell says on the way is the air of the next press, unless that is long after
        let air = if rests || next.is_none() { None } else { Some(self.hand.cell.close_air().await?) };
        self.hand.cell.watch.pause();
        let Pressed { levels: held, air_n, touched_mm, lesson } = pressed;
        let level = |(level, held): (usize, &Held)| dataset::Press {
            air_before_n: Some(air_n),
            air_after_n: air.map(|air| air.mean_n),
            ..self.row(entry, level, held, touched_mm)
        };
        let levels = held.iter().enumerate().map(level).map(dataset::Press::rounded).collect();
        let truth = held.iter().filter_map(|held| held.truth.map(PressTruth::rounded)).collect();
        let left = next.map(|_| Left { z_mm: self.hand.z_mm, air });
        Ok(Contact { press: entry.press, levels, truth, lesson, left })
    }

    /// A contact at a place. All that is random in a simulated one follows from its number, so that it is the same whether it
    /// was made after the one before or on another day.
    pub async fn contact(&mut self, number: u64, place: Place, task: &Task, next: Place) -> Result<Pressed, Halt> {
        self.go_to(place).await?;
        self.hand.stage.afresh();
        self.hand.cell.begin().await;
        if let Some(probe) = &self.hand.probe {
            probe.begin_press(number);
        }
        self.hand.stage.guard(Some(self.guard_n())).await?; // some exchanges, in which no force is read
        self.hand.cell.watch.pause();
        let air = self.air().await?;
        let first_mm = self.first_mm(place, next);
        let mut press = ForceLoop::new(task.clone(), self.context(place, task, first_mm));
        let mut levels: Vec<Held> = Vec::with_capacity(task.levels.len());
        let air_n = air.mean_n;
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
                    let window = self.hand.sample(seconds, self.conditions.spec.array.range_v).await?;
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
        Ok(Pressed { levels, air_n, touched_mm: press.touched_mm(), lesson: press.lesson() })
    }

    /// Goes to a place in the clear.
    pub async fn go_to(&mut self, place: Place) -> Result<(), Halt> {
        let first_mm = self.first_mm(self.hand.place, place);
        self.hand.travel(place, &self.permit, first_mm).await
    }

    /// What the cell says in the clear: on the way here, and now, since a disk may have been slow meanwhile.
    async fn air(&mut self) -> Result<AirReadings, Halt> {
        match self.left.take().and_then(|left| left.air) {
            Some(air) => {
                self.hand.cell.force_n().await?;
                Ok(air)
            }
            None => {
                self.hand.cell.open_air();
                self.hand.cell.close_air().await
            }
        }
    }

    /// The reading at which the controller's own guard ends a motion: a little over what the watch trips at, N.
    fn guard_n(&self) -> f64 {
        let zero = self.hand.cell.watch.zero();
        zero.offset_n + self.conditions.spec.limits.force_n + GUARD_SIGMAS * zero.sigma_n
    }

    fn context(&self, place: Place, task: &Task, first_mm: f64) -> Context {
        let (force_set_n, limits) = (task.most_n(), self.conditions.spec.limits);
        let asks = task.strategy == Strategy::Map && task.levels.len() == 1;
        Context {
            place,
            limits,
            permit: self.permit,
            zero: *self.hand.cell.watch.zero(),
            expected: self.map.expect(place),
            shot: asks.then(|| self.map.shot(place, force_set_n, &limits)).flatten(),
            clear_mm: first_mm - TRAVEL_CLEARANCE_MM,
            speed_mm_s: self.hand.usage.speed_mm_s,
            timing: self.hand.timing,
        }
    }

    /// The earliest z at which there can be contact at either of two places, mm.
    fn first_mm(&self, here: Place, there: Place) -> f64 {
        self.map.expect(here).first_mm.min(self.map.expect(there).first_mm)
    }

    fn row(&mut self, entry: &Entry, level: usize, held: &Held, touched_mm: Option<f64>) -> dataset::Press {
        let Held { window, z_mm, .. } = held;
        let force_set_n = entry.task.levels[level].force_set_n;
        let in_contact = force_set_n > 0.0;
        let flags = self.flags(entry, level, held);
        dataset::Press {
            press: entry.press,
            level: level as u64,
            phase: Some(entry.phase),
            x_mm: entry.place.x_mm,
            y_mm: entry.place.y_mm,
            force_set_n: Some(force_set_n),
            force_n: Some(window.force_n),
            depth_mm: Some(touched_mm.filter(|_| in_contact).map_or(0.0, |touched_mm| z_mm - touched_mm)),
            t_s: Some(self.conditions.clock.at_s(window.began)),
            outputs: window.outputs.clone(),
            flags,
            z_mm: Some(self.hand.frame.to_stage(entry.place, *z_mm).z_mm),
            ..dataset::Press::default()
        }
    }

    /// What is wrong with a level that was held.
    fn flags(&mut self, entry: &Entry, level: usize, held: &Held) -> Vec<Flag> {
        let (window, force_set_n) = (&held.window, entry.task.levels[level].force_set_n);
        let missed = (window.force_n - force_set_n).abs() > entry.task.force_tolerance_n;
        let felt = (entry.place, force_set_n);
        // twice the same load may read twice the same
        let before = self.felt.as_ref().filter(|(load, _)| *load != felt).map(|(_, outputs)| outputs.as_slice());
        let frozen = force_set_n > 0.0 && window.is_frozen(before);
        if force_set_n > 0.0 {
            self.felt = Some((felt, window.outputs.clone()));
        }
        let all =
            [(Flag::OutOfTolerance, missed), (Flag::Saturated, window.saturated), (Flag::Stale, window.late || frozen)];
        all.into_iter().filter(|(_, is_so)| *is_so).map(|(flag, _)| flag).collect()
    }

    fn truth(&self) -> Option<PressTruth> {
        let truth = self.hand.probe.as_ref()?.take_truth();
        Some(PressTruth {
            force_true_n: truth.force_true_n,
            force_peak_n: truth.force_peak_n,
            depth_peak_mm: truth.depth_peak_mm,
        })
    }
}
