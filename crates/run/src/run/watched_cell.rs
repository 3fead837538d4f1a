//! The load cell in use: each reading is believed or left out, passes the watch, and is shown.

use super::air::NoLoadForces;
use super::series::{LargestReading, RecordedDevice};
use super::{Cancel, Halt};
use crate::rig::RigSpec;
use palpate_control::{
    Belief, Believed, Glitches, Mean, Trip, Watch, ZeroLine, check_sound, mean_of, without_glitches,
};
use palpate_core::quantity::ForceReading;
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, sleep, sleep_until};

/// Age at which a force is read again before a motion, as a fraction of the age at which it is stale: the next reading takes its time too.
pub(super) const OLD_SHARE: f64 = 0.5;

/// Load cell with its watch, read no faster than it converts.
pub(super) struct WatchedLoadCell<'a, C> {
    pub cell: RecordedDevice<C>,
    pub watch: Watch,
    pub cancel: &'a Cancel,
    /// Called for every force, to show it to a person.
    pub shown: &'a dyn Fn(f64),
    pub(super) began: Instant,
    next: Instant,
    last: Option<Instant>,
    /// Last forces sideways, N from the zero; `None` for a cell with one axis.
    pub side_n: Option<[f64; 2]>,
    /// Time at which the stage is at rest. No earlier force belongs to a stage at rest.
    pub settled: Instant,
    /// Time at which a motion was halted.
    pub halted: Option<Instant>,
    /// Whether the force rose beyond the limit after a stop, and the stage wasn't aborted yet.
    pub presses_on: bool,
    pub(super) no_load: NoLoadForces,
    /// Which readings are believed; `None` before the cell was read at rest.
    pub believed: Option<Believed>,
    /// Line of the zero over time; `None` before there is a zero.
    pub(super) line: Option<ZeroLine>,
    /// Time and reading of the first zero, s and N; `None` before there is one.
    pub(super) first_zero: Option<(f64, f64)>,
    /// Largest reading before those that are doubted.
    known_largest: Option<LargestReading>,
    /// Change of the force at once that doubted readings have shown since the press began, N.
    pub(super) changed_n: Option<f64>,
    /// Time of the last reading that counted, by the readings' clock, s.
    pub(super) read_s: f64,
    /// Whether the stage moves, and whether it is stopped if two readings in a row are doubted.
    motion: Option<OnDoubt>,
    /// Whether the last motion was stopped because readings were doubted.
    stopped_by_doubt: bool,
}

/// What becomes of a motion if two readings in a row are doubted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OnDoubt {
    /// It is stopped.
    Stop,
    /// It continues, because it leads away or ends where it is safe.
    Continue,
}

impl<'a, C: LoadCell> WatchedLoadCell<'a, C> {
    pub(super) fn new(cell: C, watch: Watch, cancel: &'a Cancel, shown: &'a dyn Fn(f64)) -> Self {
        let now = Instant::now();
        let no_load = NoLoadForces::default();
        WatchedLoadCell {
            cell: RecordedDevice::new(cell),
            watch,
            cancel,
            shown,
            began: now,
            next: now,
            last: None,
            side_n: None,
            settled: now,
            halted: None,
            presses_on: false,
            no_load,
            believed: None,
            line: None,
            first_zero: None,
            read_s: 0.0,
            changed_n: None,
            known_largest: None,
            motion: None,
            stopped_by_doubt: false,
        }
    }

    /// Begins to decide which readings are believed, by the noise of the present watch. The cell was read at this time last, s.
    pub(super) fn believe(&mut self, spec: &RigSpec, at_s: f64) {
        let jolt_n = Watch::jolt_n(spec.air_n(), spec.stage.acceleration_mm_s2);
        let conversion_s = self.cell.conversion().as_secs_f64();
        let mut believed = Believed::new(spec.limits.stiffness_n_mm, conversion_s, jolt_n);
        believed.rests_at(self.watch.zero().offset_n, at_s);
        self.believed = Some(believed);
    }

    /// Readings that were left out.
    pub(super) fn glitches(&self) -> Glitches {
        self.believed.as_ref().map_or_else(Glitches::default, Believed::glitches)
    }

    /// States that a motion begins.
    pub(super) fn moves(&mut self, speed_mm_s: f64, on_doubt: OnDoubt) {
        self.motion = Some(on_doubt);
        self.stopped_by_doubt = false;
        self.believed.iter_mut().for_each(|believed| believed.moves(speed_mm_s));
    }

    /// States that no motion is under way. The stage settles still.
    pub(super) fn rests(&mut self) {
        self.motion = None;
    }

    /// Whether the last motion was stopped because readings were doubted.
    pub(super) fn is_stopped_by_doubt(&self) -> bool {
        self.stopped_by_doubt
    }

    /// Returns the next reading, and the one before if it counts too late; `None` if it is left out.
    pub(super) async fn next_reading(&mut self) -> Result<Option<(Option<ForceReading>, ForceReading)>, Halt> {
        self.due().await?;
        let largest = self.cell.largest;
        let reading = self.cell.read().await?;
        let Some(believed) = &mut self.believed else { return Ok(Some((None, reading))) };
        if self.motion.is_none() && Instant::now() > self.settled + self.cell.conversion() {
            believed.moves(0.0);
        }
        let belief = believed.take(&reading, self.watch.zero())?;
        let known = self.known_largest.take();
        let (is_doubted, counts) = match belief {
            Belief::Believed(reading) => {
                if let Some(known) = known {
                    // what was doubted was no force
                    self.cell.largest = known;
                    self.cell.largest.take(&reading);
                }
                (false, Some((None, reading)))
            }
            Belief::Changed(reading, by_n) => {
                self.changed_n = Some(by_n);
                (false, Some((None, reading)))
            }
            Belief::Rises([earlier, reading]) => (true, Some((Some(earlier), reading))),
            Belief::LeftOut | Belief::Doubted => {
                self.known_largest = Some(known.unwrap_or(largest));
                (belief == Belief::Doubted, None)
            }
        };
        self.stopped_by_doubt |= is_doubted && self.motion == Some(OnDoubt::Stop);
        if counts.is_none() {
            self.watch.heard(reading.at_s);
        }
        Ok(counts)
    }

    /// Waits until the cell's next conversion is due.
    pub(super) async fn due(&mut self) -> Result<(), Halt> {
        self.cancel.check()?;
        self.cell.series.as_ref().map_or(Ok(()), |series| series.check())?;
        let now = Instant::now();
        if self.next > now {
            sleep_until(self.next).await;
        }
        self.next = self.next.max(now) + self.cell.conversion();
        Ok(())
    }

    /// Begins a press with a new conversion. The earlier readings no longer matter. The clock of the press starts here.
    pub(super) async fn begin(&mut self) {
        sleep(self.cell.conversion()).await;
        self.cell.forget_timing();
        (self.began, self.changed_n) = (Instant::now(), None);
        self.next = self.began;
    }

    /// Reads before there is a zero: at least `least` readings and for at least `seconds`. The readings are sound, but no forces
    /// yet.
    pub(super) async fn sound_readings(&mut self, least: usize, seconds: f64) -> Result<Vec<ForceReading>, Halt> {
        let count = least.max((seconds / self.cell.conversion().as_secs_f64()) as usize);
        let mut readings = Vec::with_capacity(count);
        for _ in 0..count {
            self.due().await?;
            readings.push(self.cell.read().await?);
        }
        let (readings, glitches) = without_glitches(&readings)?;
        self.believed.iter_mut().for_each(|believed| believed.count(&glitches));
        readings.iter().try_for_each(check_sound)?;
        Ok(readings)
    }

    /// Returns the next sound reading, which is no force yet.
    pub(super) async fn sound_reading(&mut self) -> Result<ForceReading, Halt> {
        loop {
            if let Some((_, reading)) = self.next_reading().await? {
                check_sound(&reading)?;
                return Ok(reading);
            }
        }
    }

    /// Returns the next force, N from the zero. Every reading passes the trip rules.
    pub(super) async fn force_n(&mut self) -> Result<f64, Halt> {
        loop {
            if let Some(force_n) = self.heard_n().await? {
                return Ok(force_n);
            }
        }
    }

    /// Returns the next force, N from the zero; `None` if the reading is left out.
    pub(super) async fn heard_n(&mut self) -> Result<Option<f64>, Halt> {
        let Some((earlier, reading)) = self.next_reading().await? else { return Ok(None) };
        if let Some(earlier) = earlier {
            self.watched(&earlier)?;
        }
        Ok(Some(self.watched(&reading)?))
    }

    /// Returns a reading's force, N from the zero.
    pub(super) fn watched(&mut self, reading: &ForceReading) -> Result<f64, Trip> {
        let force_n = self.watch.force_n(reading).map_err(|trip| self.without_load(trip))?;
        self.take(reading, force_n);
        Ok(force_n)
    }

    pub(super) fn take(&mut self, reading: &ForceReading, force_n: f64) {
        (self.shown)(force_n);
        let now = Instant::now();
        (self.last, self.read_s) = (Some(now), reading.at_s);
        self.side_n = self.watch.zero().side.zip(reading.side_n).map(|(zero, side_n)| zero.from_zero(side_n));
        self.no_load.take(now, reading);
    }

    /// Time used by the parts of a press, s.
    pub(super) fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Age of the last good reading, s.
    pub(super) fn age_s(&self) -> f64 {
        self.last.map_or(f64::INFINITY, |last| last.elapsed().as_secs_f64())
    }

    /// Reads the force again at rest if the last one is old, because a slow array or stage was read meanwhile. Nothing moved, so no reading
    /// was due in between.
    pub(super) async fn renew(&mut self) -> Result<(), Halt> {
        if self.age_s() > OLD_SHARE * self.watch.zero().stale_s() {
            self.watch.pause();
            self.force_n().await?;
        }
        Ok(())
    }

    /// Reads until the stage is at rest and the cell has followed.
    pub(super) async fn settle(&mut self) -> Result<(), Halt> {
        while Instant::now() < self.settled {
            self.force_n().await?;
        }
        Ok(())
    }

    /// Returns the mean of at least `readings` readings of a stage at rest, N from the zero.
    pub(super) async fn mean_n(&mut self, readings: u32) -> Result<f64, Halt> {
        self.settle().await?;
        let least_s = self.whole_s(f64::from(readings) * self.cell.conversion().as_secs_f64());
        Ok(self.read_for(readings, least_s).await?.value)
    }

    /// Least duration of a mean, independent of its number of readings, s: complete periods of the mains interference; 0 if there is no
    /// mains interference.
    pub(super) fn whole_s(&self, least_s: f64) -> f64 {
        let zero = self.watch.zero();
        if zero.mains.is_some() { zero.mean_s(least_s) } else { 0.0 }
    }

    /// Returns the mean of at least `readings` readings over at least `seconds` after the first reading. Its middle is in the
    /// time of the press' clock.
    pub(super) async fn read_for(&mut self, readings: u32, seconds: f64) -> Result<Mean, Halt> {
        let mut read: Vec<(f64, f64)> = Vec::new();
        while read.len() < readings.max(1) as usize || self.now_s() - read[0].0 < seconds {
            let force_n = self.force_n().await?;
            read.push((self.now_s(), force_n));
        }
        Ok(mean_of(&read, self.watch.zero()).unwrap_or(Mean { value: f64::NAN, middle_s: self.now_s(), readings: 0 }))
    }
}
