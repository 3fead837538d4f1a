//! The instruments in use.

use super::no_load_outputs::NoLoadOutputs;
use super::series::{LargestReading, RecordedDevice, SeriesRecorder};
use super::window::OutputMeans;
use super::{Cancel, Halt};
use crate::rig::{AdjustedCell, ArraySpec, GroundTruth, RigSpec};
use palpate_control::{
    Belief, Believed, Drift, Glitches, Mean, NO_LOAD_READINGS, NoLoadReadings, SafetyRule, Timing, Trip, Watch, Zero,
    ZeroLine, check_sound, mean_of, without_glitches,
};
use palpate_core::quantity::{ForceReading, Frame, Limits, Place};
use palpate_data::dataset::{NoLoad, PressTruth};
use palpate_drivers::{AnyArray, AnyStage};
use palpate_link::device::{Instruments, LoadCell, SensorArray, Stage, StageUse};
use palpate_link::time::{Instant, sleep, sleep_until};
use palpate_link::wire::Claims;
use std::cmp::Ordering::{Equal, Less};
use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::rc::Rc;
use tokio::sync::Notify;

/// Time for which readings without load are kept, s, and largest number of kept readings. The zero may have moved since older readings.
const NO_LOAD_S: f64 = 0.3;
const NO_LOAD_MAX: usize = 4096;
/// Least time of the readings without load, s, so that its mean is almost as good as a window's.
const NO_LOAD_LEAST_S: f64 = 0.05;
/// Largest change of an output between two looks of the first descent, in sd of a reading. The other constants allow for a
/// converter's steps and a slow drift, as fractions of the array's range, or of the output if the range is unknown.
const OUTPUT_SIGMAS: f64 = 10.0;
const RANGE_SHARE: f64 = 5e-4;
const OUTPUT_SHARE: f64 = 1e-3;
/// Number of successive readings that must show such a change.
pub(super) const OUTPUT_LOOKS: usize = 3;
/// Age at which a force is read again before a motion, as a fraction of the age at which it is stale: the next reading takes its time too.
pub(super) const OLD_SHARE: f64 = 0.5;
/// Number of force readings that detect a light touch, and least mean above zero, in sd.
const LIGHT_READINGS: u32 = 20;

/// Least number of equal readings of a cell that doesn't follow a contact.
const EQUAL_LEAST: u32 = 20;

/// Number of readings at rest that show a drift, and least time for them, s. And the force that is off over what the drift explains: it may
/// have begun or ended in between, but a touch adds a step.
const DRIFT_READINGS: usize = 50;
const DRIFT_LOOK_S: f64 = 0.5;
const EXPLAINED: RangeInclusive<f64> = 0.5..=1.5;
const LIGHT_SIGMAS: f64 = 4.0;

/// Outputs at rest, before the first touch.
pub(super) struct KnownOutputs {
    /// Outputs of the last look at which they hadn't moved.
    pub outputs: Vec<f64>,
    /// Force of a touch too light to count as contact, N, if there was one.
    pub light_n: Option<f64>,
}
/// Least number of output readings without load, and largest number on the way from place to place. The largest number is that of a
/// window.
const NO_LOAD_OUTPUTS: u32 = 10;
pub(super) const OUTPUTS_ON_THE_WAY: u32 = 20;

/// Instruments in use, which carry out the commands of a press.
pub(super) struct RigControl<'a, S, C, A> {
    pub stage: S,
    pub cell: WatchedLoadCell<'a, C>,
    pub array: RecordedDevice<A>,
    /// Recorder of the readings of presses, if they are kept.
    pub series: Option<Rc<SeriesRecorder>>,
    pub frame: Frame,
    pub usage: StageUse,
    pub timing: Timing,
    pub truth: GroundTruth,
    /// Outputs without load; outputs are relative to them.
    pub no_load: Vec<f64>,
    /// Standard deviation of one reading of each output.
    no_load_sigmas: Vec<f64>,
    /// Whether the array answers, so that its outputs are watched before there is a zero and on the way out.
    pub array_answers: bool,
    /// Outputs before there is a zero.
    pub unzeroed: Option<NoLoadOutputs>,
    /// Outputs that are being read without load now.
    pub no_load_outputs: OutputMeans,
    /// Position of the indenter: specimen frame, read back.
    pub place: Place,
    pub z_mm: f64,
    /// What the declared stiffness gives at the depth where a trip stopped z, N.
    pub by_depth_n: Option<f64>,
    /// Place at which a stage with steps really stands, read back; the target of any other.
    pub pressed: Place,
    /// Claims on the links, so that nobody else drives the instruments during this time.
    _claims: Claims,
}

/// Load cell with its watch, read no faster than it converts.
pub(super) struct WatchedLoadCell<'a, C> {
    pub cell: RecordedDevice<C>,
    pub watch: Watch,
    pub cancel: &'a Cancel,
    /// Called for every force, to show it to a person.
    pub shown: &'a dyn Fn(f64),
    began: Instant,
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
    no_load: NoLoadForces,
    /// Which readings are believed; `None` before the cell was read at rest.
    pub believed: Option<Believed>,
    /// Line of the zero over time; `None` before there is a zero.
    line: Option<ZeroLine>,
    /// Largest reading before those that are doubted.
    known_largest: Option<LargestReading>,
    /// Change of the force at once that doubted readings have shown since the press began, N.
    changed_n: Option<f64>,
    /// Time of the last reading that counted, by the readings' clock, s.
    read_s: f64,
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

/// Newest readings of the cell without load, collected as they arrive.
#[derive(Debug, Default)]
struct NoLoadForces {
    /// Whether the current readings are readings without load.
    open: bool,
    /// Times of the readings, and the cell's readings, N: the force, and those sideways.
    readings: VecDeque<(Instant, f64, Option<[f64; 2]>)>,
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
    async fn next_reading(&mut self) -> Result<Option<(Option<ForceReading>, ForceReading)>, Halt> {
        self.due().await?;
        let largest = self.cell.largest;
        let reading = self.cell.read().await?;
        let Some(believed) = &mut self.believed else { return Ok(Some((None, reading))) };
        if self.motion.is_none() && Instant::now() > self.settled + self.cell.conversion() {
            believed.moves(0.0);
        }
        let belief = believed.take(&reading, self.watch.zero())?;
        let known = match belief {
            Belief::LeftOut | Belief::Doubted => Some(self.known_largest.unwrap_or(largest)),
            _ => None,
        };
        let (is_doubted, counts) = match belief {
            Belief::Believed(reading) => {
                if let Some(known) = self.known_largest {
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
            Belief::LeftOut => (false, None),
            Belief::Doubted => (true, None),
            Belief::Rises([earlier, reading]) => (true, Some((Some(earlier), reading))),
        };
        self.known_largest = known;
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

    fn take(&mut self, reading: &ForceReading, force_n: f64) {
        (self.shown)(force_n);
        let now = Instant::now();
        (self.last, self.read_s) = (Some(now), reading.at_s);
        self.side_n = self.watch.zero().side.zip(reading.side_n).map(|(zero, side_n)| zero.from_zero(side_n));
        self.no_load.take(now, reading);
    }

    /// Returns the real cause of a broken rule: without load, noise that has grown breaks the other rules first.
    pub(super) fn without_load(&self, trip: Trip) -> Trip {
        let (sigma_n, most_n) = (self.no_load.sigma_n(), self.watch.zero().noise_most_n());
        let noisy = self.no_load.open && self.no_load.count() >= NO_LOAD_READINGS && sigma_n > most_n;
        match (trip.rule, self.changed_n) {
            (SafetyRule::WrongSign | SafetyRule::StillTouching, _) if noisy => {
                Trip::new(SafetyRule::Noisy, sigma_n, most_n, "N")
            }
            (SafetyRule::WrongSign, Some(by_n)) => Trip::new(SafetyRule::Jumped, by_n, trip.limit.abs(), "N"),
            _ => trip,
        }
    }

    /// Returns the real cause of a broken rule at rest, before the first touch. Noise that has grown looks like an early touch.
    /// It also hides a real touch from the force while the outputs show it.
    pub(super) async fn at_first_touch(&mut self, trip: Trip) -> Trip {
        if trip.rule == SafetyRule::OutputsMoved && self.watch.equal() >= EQUAL_LEAST {
            // a cell that repeats its reading is sound until something presses it
            let (equal, least) = (f64::from(self.watch.equal()), f64::from(EQUAL_LEAST));
            return Trip::new(SafetyRule::Frozen, equal, least, "equal readings while the array shows a contact");
        }
        if !matches!(trip.rule, SafetyRule::SurfaceElsewhere | SafetyRule::OutputsMoved) {
            return trip;
        }
        let Ok(sigma_n) = self.still_sigma_n().await else { return trip };
        let most_n = self.watch.zero().noise_most_n();
        if sigma_n > most_n { Trip::new(SafetyRule::Noisy, sigma_n, most_n, "N") } else { trip }
    }

    /// Returns the real cause of a rule that was broken by a force of the air: a drift looks like a touch, or like a push that reads as a pull. The
    /// stage rests. It states the rate, and the one that would have passed.
    pub(super) async fn unless_it_drifts(&mut self, trip: Trip) -> Trip {
        let limit_n = match trip.rule {
            SafetyRule::SurfaceElsewhere => self.watch.zero().detect_n(),
            SafetyRule::WrongSign | SafetyRule::ForceRose | SafetyRule::ForceFell | SafetyRule::ZeroDrifted => {
                trip.limit.abs()
            }
            _ => return trip,
        };
        let Some(now) = self.still().await else { return trip };
        let before = *self.watch.zero();
        let (off_n, age_s) = (now.offset_n - before.at_n(now.at_s), now.at_s - before.at_s);
        let by_drift_n = (now.drift.rate_n_s - before.drift.rate_n_s) * age_s;
        if now.drift.rate_n_s == 0.0 || !EXPLAINED.contains(&(off_n / by_drift_n)) {
            return trip;
        }
        let rate_n_s = now.drift.rate_n_s;
        let most_n_s = (limit_n / off_n * rate_n_s).abs().min(Drift::most_n_s(self.watch.limit_n()));
        Trip::new(SafetyRule::Drifts, rate_n_s, most_n_s, "N/s")
    }

    /// Returns the reading of a stage that rests, with its drift; `None` if the cell doesn't answer, or reports a fault.
    pub(super) async fn still(&mut self) -> Option<Zero> {
        let conversion_s = self.cell.conversion().as_secs_f64();
        let mut readings = Vec::new();
        for _ in 0..DRIFT_READINGS.max((DRIFT_LOOK_S / conversion_s) as usize) {
            sleep(self.cell.conversion()).await;
            readings.push(self.cell.read().await.ok().filter(|reading| check_sound(reading).is_ok())?);
        }
        Some(Zero::of(&readings, conversion_s))
    }

    /// Noise of some more readings at rest, N.
    async fn still_sigma_n(&mut self) -> Result<f64, Halt> {
        let mut still = NoLoadForces { open: true, ..NoLoadForces::default() };
        for _ in 0..LIGHT_READINGS {
            let reading = self.sound_reading().await?;
            still.take(Instant::now(), &reading);
        }
        Ok(still.sigma_n())
    }

    /// Returns the line of the zero by readings without load: through them alone, or through all air so far, whichever knows the rate better.
    pub(super) fn line(&self, readings: &[ForceReading]) -> ZeroLine {
        let alone = ZeroLine::of(readings);
        let together = self.line.map(|line| line.continued(&alone));
        together.filter(|line| line.drift().sigma_n_s < alone.drift().sigma_n_s).unwrap_or(alone)
    }

    /// Makes forces relative to a new zero that was taken from these readings.
    pub(super) fn zero(&mut self, limits: &Limits, zero: Zero, readings: &[ForceReading]) {
        let line = self.line(readings);
        self.watch = Watch::new(limits, Zero { drift: line.drift(), ..zero });
        self.line = Some(line);
    }

    /// Makes forces relative to this air, and to the drift that all air so far has shown, which it states.
    fn count_from(&mut self, no_load: &mut NoLoadReadings) {
        let sigma_n = self.watch.zero().sigma_own_n(no_load.readings);
        let drift = self.line.as_mut().map(|line| {
            *line = line.read(no_load.at_s, no_load.mean_n, sigma_n);
            line.drift()
        });
        let drift = drift.unwrap_or_default();
        no_load.drift = (drift.rate_n_s != 0.0).then_some(drift);
        self.watch.count_from(no_load, drift);
    }

    /// Time of the last reading by the readings' clock, s.
    pub(super) fn read_s(&self) -> f64 {
        self.read_s
    }

    /// Time used by the parts of a press, s.
    pub(super) fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Whether readings count as air.
    pub(super) fn is_no_load_open(&self) -> bool {
        self.no_load.open
    }

    /// Treats the readings from now on as air.
    pub(super) fn begin_no_load(&mut self) {
        self.no_load = NoLoadForces { open: true, ..NoLoadForces::default() };
    }

    /// Returns the newest readings without load, and reads more until there are enough; the stage must be at rest. Later readings are
    /// no longer air.
    pub(super) async fn end_no_load(&mut self) -> Result<NoLoadReadings, Halt> {
        if !self.no_load.open {
            self.begin_no_load();
        }
        let least_s = self.watch.zero().mean_s(NO_LOAD_LEAST_S);
        while self.no_load.count() < NO_LOAD_READINGS || self.no_load.span_s() < least_s {
            let Some((_, reading)) = self.next_reading().await? else { continue };
            let force_n = self.watch.no_load_n(&reading)?;
            self.take(&reading, force_n);
        }
        self.no_load.open = false;
        let (sigma_n, most_n) = (self.no_load.sigma_n(), self.watch.zero().noise_most_n());
        if sigma_n > most_n {
            let (rest_n, jump_n) = self.no_load.sigma_without_jump_n();
            // one jump may be the first reading of a noise
            if rest_n <= most_n && self.still_sigma_n().await? <= most_n {
                return Err(Trip::new(SafetyRule::ZeroDrifted, jump_n, most_n, "N").into());
            }
        }
        let newest = self.no_load.readings.back().map_or(self.began, |(at, ..)| *at);
        let before = |at: Instant| -(newest - at).as_secs_f64();
        let readings: Vec<(f64, f64)> = self.no_load.readings.iter().map(|&(at, n, _)| (before(at), n)).collect();
        let mean =
            mean_of(&readings, self.watch.zero()).ok_or_else(|| Trip::new(SafetyRule::Stale, 0.0, 0.0, "readings"))?;
        let side_mean_n = side_mean(self.no_load.readings.iter().map(|(.., side_n)| *side_n));
        let (age_s, at_s) = (-mean.middle_s, self.read_s + mean.middle_s);
        Ok(NoLoadReadings {
            mean_n: mean.value,
            sigma_n,
            readings: mean.readings,
            age_s,
            at_s,
            drift: None,
            side_mean_n,
        })
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

impl NoLoadForces {
    fn count(&self) -> u32 {
        self.readings.len() as u32
    }

    fn span_s(&self) -> f64 {
        let ends = self.readings.front().zip(self.readings.back());
        ends.map_or(0.0, |((first, ..), (last, ..))| (*last - *first).as_secs_f64())
    }

    /// Squared differences of successive readings, N^2.
    fn squares(&self) -> impl Iterator<Item = f64> {
        let following = self.readings.iter().skip(1);
        self.readings.iter().zip(following).map(|((_, a, _), (_, b, _))| (b - a).powi(2))
    }

    /// Noise of one reading, from the differences of successive readings. An increasing force or a drifting zero isn't noise.
    fn sigma_n(&self) -> f64 {
        (self.squares().sum::<f64>() / (2.0 * f64::from(self.count().max(2) - 1))).sqrt()
    }

    /// The same without the largest difference, which is returned too: a zero that jumps once isn't noise.
    fn sigma_without_jump_n(&self) -> (f64, f64) {
        let (sum, largest) = (self.squares().sum::<f64>(), self.squares().fold(0.0, f64::max));
        (((sum - largest).max(0.0) / (2.0 * f64::from(self.count().max(3) - 2))).sqrt(), largest.sqrt())
    }

    fn take(&mut self, now: Instant, reading: &ForceReading) {
        if !self.open {
            return;
        }
        let is_old = |&(at, ..): &(Instant, f64, Option<[f64; 2]>)| (now - at).as_secs_f64() > NO_LOAD_S;
        while self.readings.len() >= NO_LOAD_MAX
            || (self.count() > NO_LOAD_READINGS && self.readings.front().is_some_and(is_old))
        {
            self.readings.pop_front();
        }
        self.readings.push_back((now, reading.force_n, reading.side_n));
    }
}

/// The hand of a rig. Tests have a hand with other instruments.
pub(super) type AnyRigControl<'a> = RigControl<'a, AnyStage, AdjustedCell, AnyArray>;

impl<'a, S: Stage, C: LoadCell, A: SensorArray> RigControl<'a, S, C, A> {
    /// Creates prepared instruments with a measured zero; the axes are read back.
    pub(super) fn new(
        instruments: Instruments<S, WatchedLoadCell<'a, C>, A>,
        frame: Frame,
        usage: StageUse,
        timing: Timing,
        truth: GroundTruth,
        claims: Claims,
    ) -> Self {
        let Instruments { stage, load_cell: cell, array } = instruments;
        let (no_load, no_load_sigmas) = (vec![0.0; array.units()], Vec::new());
        let (place, z_mm, no_load_outputs) = (Place::default(), 0.0, OutputMeans::default());
        let pressed = place;
        RigControl {
            stage,
            cell,
            array: RecordedDevice::new(array),
            series: None,
            frame,
            usage,
            timing,
            truth,
            no_load,
            no_load_sigmas,
            array_answers: false,
            unzeroed: None,
            by_depth_n: None,
            no_load_outputs,
            place,
            z_mm,
            pressed,
            _claims: claims,
        }
    }

    /// Keeps the readings of presses.
    pub(super) fn record(&mut self, series: SeriesRecorder) {
        let series = Some(Rc::new(series));
        (self.cell.cell.series, self.array.series) = (series.clone(), series.clone());
        self.series = series;
    }

    /// Treats the readings from now on as air.
    pub(super) fn begin_no_load(&mut self) {
        self.cell.begin_no_load();
        self.no_load_outputs = OutputMeans::default();
    }

    /// Returns the readings of cell and array without load, and reads more until there are enough; the stage must be at rest.
    pub(super) async fn end_no_load(&mut self) -> Result<NoLoad, Halt> {
        let (watched_cell, array, means) = (&mut self.cell, &mut self.array, &mut self.no_load_outputs);
        let over = Notify::new();
        let force = async {
            let force = watched_cell.end_no_load().await;
            if force.is_err() {
                over.notify_one(); // the stage is stopped at once
            }
            force
        };
        let goes_on = |readings| readings < NO_LOAD_OUTPUTS;
        let outputs = means.take_while(array, &over, || true, goes_on, |_, _| Ok(()));
        let (force, read) = tokio::join!(force, outputs);
        let force = force?;
        read?;
        self.no_load_sigmas = means.sigmas();
        Ok(NoLoad { force, outputs: std::mem::take(means).means })
    }

    /// Checks that the outputs still equal the outputs of the last check, `known`, or the outputs without load. Before the first touch,
    /// the outputs are a second witness. A cell that reads zero with plausible noise under any load shows nothing of a contact. A
    /// touch too light to count as contact also moves the outputs; then a mean of the force shows the touch. If they move again without
    /// a larger force, the cell doesn't show the contact.
    pub(super) async fn check_outputs_rest(&mut self, known: &mut KnownOutputs, array: &ArraySpec) -> Result<(), Halt> {
        let mut now = vec![0.0; self.array.units()];
        let mut worst = (0.0, 0.0);
        for _ in 0..OUTPUT_LOOKS {
            self.cell.watched_while(self.array.read(&mut now)).await?.map_err(Halt::unread)?;
            match moved_beyond(&known.outputs, &now, &self.no_load_sigmas, array.range_v) {
                Some(beyond) => worst = beyond,
                None => {
                    known.outputs.clone_from(&now);
                    return Ok(());
                }
            }
        }
        self.cell.renew().await?;
        let force_n = self.cell.mean_n(LIGHT_READINGS).await?;
        let least_n = LIGHT_SIGMAS * self.cell.watch.zero().sigma_mean_n(LIGHT_READINGS);
        // an approach in pieces often ends in such a touch; the next piece adds a touch at most, and has to show a larger force
        let is_first_piece = self.usage.abilities.finishes() && known.light_n.is_none();
        if force_n > known.light_n.unwrap_or(0.0) + least_n || is_first_piece {
            known.light_n = Some(force_n.max(0.0));
            return Ok(());
        }
        let moved = Trip::new(SafetyRule::OutputsMoved, worst.0, worst.1, &array.unit);
        Err(self.cell.at_first_touch(moved).await.into())
    }

    /// Standard deviation of one output over a window, in the array's unit, by the noise without load.
    pub(super) fn output_sigma(&self) -> f64 {
        common(&self.no_load_sigmas) / f64::from(NO_LOAD_OUTPUTS).sqrt()
    }

    /// Returns the true events since the last call, in a simulated run.
    pub(super) fn press_truth(&self) -> Option<PressTruth> {
        let truth = self.truth.take()?;
        Some(PressTruth {
            force_true_n: truth.force_true_n,
            force_peak_n: truth.force_peak_n,
            depth_peak_mm: truth.depth_peak_mm,
        })
    }

    /// Makes forces and outputs relative to this air.
    pub(super) fn count_from(&mut self, no_load: &mut NoLoad) {
        self.cell.count_from(&mut no_load.force);
        self.series.iter().for_each(|series| series.count_from(no_load));
        self.no_load.clone_from(&no_load.outputs);
    }
}

/// Returns the mean forces sideways, N; `None` if a reading has none, or there are no readings.
pub(super) fn side_mean(readings: impl Iterator<Item = Option<[f64; 2]>>) -> Option<[f64; 2]> {
    let sides: Vec<[f64; 2]> = readings.collect::<Option<_>>()?;
    let mean = |axis: usize| sides.iter().map(|side_n| side_n[axis]).sum::<f64>() / sides.len() as f64;
    (!sides.is_empty()).then(|| [mean(0), mean(1)])
}

/// Returns the noise of one output in the mean over all outputs.
fn common(sigmas: &[f64]) -> f64 {
    (sigmas.iter().map(|sigma| sigma * sigma).sum::<f64>() / sigmas.len().max(1) as f64).sqrt()
}

/// Returns the first output that changed by more than allowed, and its change. Returns `None` if no output changed.
pub(super) fn moved_beyond(known: &[f64], now: &[f64], sigmas: &[f64], range: Option<f64>) -> Option<(f64, f64)> {
    // few readings determine one output's noise badly: none counts as quieter than the mean
    let common = common(sigmas);
    let mut all = known.iter().zip(now).zip(sigmas).map(|((known, now), sigma)| {
        let steps = range.map_or(OUTPUT_SHARE * known.abs(), |range| RANGE_SHARE * range);
        ((now - known).abs(), OUTPUT_SIGMAS * sigma.max(common) + steps)
    });
    // written as the positive condition, so NaN fails
    all.find(|(moved, most)| !matches!(moved.partial_cmp(most), Some(Less | Equal)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn converter_step_and_noise_are_no_contact() {
        let known = [0.5, -1.0, 1200.0];
        let sigmas = [0.0, 0.0, 0.0];
        assert_eq!(moved_beyond(&known, &[0.5 + 0.003, -1.0, 1200.0], &sigmas, Some(10.0)), None, "one step of 12 bit");
        assert_eq!(moved_beyond(&known, &[0.5, -1.0, 1201.0], &sigmas, None), None, "one count");
        assert!(moved_beyond(&known, &[0.5, -1.0, 1202.0], &sigmas, None).is_some());
        assert!(moved_beyond(&known, &[0.53, -1.0, 1200.0], &sigmas, Some(10.0)).is_some());
        assert_eq!(
            moved_beyond(&known[..2], &[0.53, -1.0], &[0.001, 0.005], Some(10.0)),
            None,
            "within the noise of all"
        );
        assert!(moved_beyond(&known, &[f64::NAN, -1.0, 1200.0], &sigmas, Some(10.0)).is_some());
    }
}
