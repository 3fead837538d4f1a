//! The instruments in use.

use super::{Cancel, Halt};
use crate::control::{AIR_READINGS, AirReadings, Rule, Timing, Trip, Watch, check_sound};
use crate::device::{Instruments, LoadCell, SensorArray, Stage, StageUse};
use crate::quantity::{ForceReading, Frame, Place};
use crate::rig::SceneProbe;
use crate::wire::Claims;
use std::time::Duration;
use tokio::time::{Instant, sleep, sleep_until};

/// The instruments in use: what carries out the commands of a press.
pub(super) struct Hand<'a, S, C, A> {
    pub stage: S,
    pub cell: Gauge<'a, C>,
    pub array: A,
    pub frame: Frame,
    pub usage: StageUse,
    pub timing: Timing,
    pub probe: Option<SceneProbe>,
    /// The outputs in air.
    pub air: Vec<f64>,
    /// Where the indenter is: specimen frame, read back.
    pub place: Place,
    pub z_mm: f64,
    /// Nobody else drives the instruments while this does.
    _claims: Claims,
}

/// The load cell under its watch, read no faster than it converts.
pub(super) struct Gauge<'a, C> {
    pub cell: C,
    pub watch: Watch,
    pub cancel: &'a Cancel,
    /// Told of every force, for a person to see.
    pub shown: &'a dyn Fn(f64),
    began: Instant,
    next: Instant,
    last: Option<Instant>,
    /// No force before this instant is that of a stage at rest.
    pub settled: Instant,
    air: AirSums,
}

/// Readings in air, as they come.
#[derive(Clone, Copy, Debug, Default)]
struct AirSums {
    /// Whether what comes is air.
    open: bool,
    count: u32,
    mean_n: f64,
    last_n: Option<f64>,
    /// Sum of the squares of what two readings in a row differ by.
    differences: f64,
}

impl<'a, C: LoadCell> Gauge<'a, C> {
    pub fn new(cell: C, watch: Watch, cancel: &'a Cancel, shown: &'a dyn Fn(f64)) -> Self {
        let now = Instant::now();
        let air = AirSums::default();
        Gauge { cell, watch, cancel, shown, began: now, next: now, last: None, settled: now, air }
    }

    /// Waits for the cell's next conversion to be due.
    pub async fn due(&mut self) -> Result<(), Halt> {
        self.cancel.check()?;
        let now = Instant::now();
        if self.next > now {
            sleep_until(self.next).await;
        }
        self.next = self.next.max(now) + self.cell.conversion();
        Ok(())
    }

    /// A press begins, with a conversion of its own: whatever was read before it has had its time. Its clock counts from here.
    pub async fn begin(&mut self) {
        sleep(self.cell.conversion()).await;
        self.cell.afresh();
        self.began = Instant::now();
        self.next = self.began;
    }

    /// Readings before there is a zero, at least so many and for at least so long: sound ones, but no forces yet.
    pub async fn sound_readings(&mut self, least: usize, seconds: f64) -> Result<Vec<ForceReading>, Halt> {
        let count = least.max((seconds / self.cell.conversion().as_secs_f64()) as usize);
        let mut readings = Vec::with_capacity(count);
        for _ in 0..count {
            self.due().await?;
            let reading = self.cell.read().await?;
            check_sound(&reading)?;
            readings.push(reading);
        }
        Ok(readings)
    }

    /// The next force, N from the zero; every reading passes the trip rules.
    pub async fn force_n(&mut self) -> Result<f64, Halt> {
        self.due().await?;
        let reading = self.cell.read().await?;
        Ok(self.watched(&reading)?)
    }

    /// A reading's force, N from the zero.
    pub fn watched(&mut self, reading: &ForceReading) -> Result<f64, Trip> {
        let force_n = self.watch.force_n(reading).map_err(|trip| self.in_air(trip))?;
        (self.shown)(force_n);
        self.last = Some(Instant::now());
        self.air.take(force_n);
        Ok(force_n)
    }

    /// What a rule that was broken is really about: in air a noise that has grown breaks the others first.
    pub fn in_air(&self, trip: Trip) -> Trip {
        let (sigma_n, most_n) = (self.air.sigma_n(), self.watch.zero().noise_most_n());
        let noisy = self.air.open && self.air.count >= AIR_READINGS && sigma_n > most_n;
        match trip.rule {
            Rule::WrongSign | Rule::StillTouching if noisy => Trip::new(Rule::Noisy, sigma_n, most_n, "N"),
            _ => trip,
        }
    }

    /// The time that the parts of a press are told, s.
    pub fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Whether what is read is taken for air.
    pub fn is_air_open(&self) -> bool {
        self.air.open
    }

    /// From here on what is read is air.
    pub fn open_air(&mut self) {
        self.air = AirSums { open: true, ..AirSums::default() };
    }

    /// What was read in air, and more of it until it is enough; what comes after it isn't air any more.
    pub async fn close_air(&mut self) -> Result<AirReadings, Halt> {
        if !self.air.open {
            self.open_air();
        }
        while self.air.count < AIR_READINGS {
            self.force_n().await?;
        }
        self.air.open = false;
        Ok(AirReadings { mean_n: self.air.mean_n, sigma_n: self.air.sigma_n(), readings: self.air.count })
    }

    /// How old the last good reading is, s.
    pub fn age_s(&self) -> f64 {
        self.last.map_or(f64::INFINITY, |last| last.elapsed().as_secs_f64())
    }

    /// Reads until the stage is at rest and the cell has followed.
    pub async fn settle(&mut self) -> Result<(), Halt> {
        while Instant::now() < self.settled {
            self.force_n().await?;
        }
        Ok(())
    }

    /// The mean of some readings of a stage at rest, N from the zero.
    pub async fn mean_n(&mut self, readings: u32) -> Result<f64, Halt> {
        self.settle().await?;
        let mut sum_n = 0.0;
        for _ in 0..readings {
            sum_n += self.force_n().await?;
        }
        Ok(sum_n / f64::from(readings.max(1)))
    }

    /// Reads for so long.
    pub async fn dwell(&mut self, seconds: f64) -> Result<(), Halt> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        while Instant::now() < until {
            self.force_n().await?;
        }
        Ok(())
    }
}

impl AirSums {
    /// Noise of one reading, from what two in a row differ by: a force that comes or a zero that drifts isn't noise.
    fn sigma_n(&self) -> f64 {
        (self.differences / (2.0 * f64::from(self.count.max(2) - 1))).sqrt()
    }

    fn take(&mut self, force_n: f64) {
        if self.open {
            self.differences += self.last_n.map_or(0.0, |last_n| (force_n - last_n).powi(2));
            self.last_n = Some(force_n);
            self.count += 1;
            self.mean_n += (force_n - self.mean_n) / f64::from(self.count);
        }
    }
}

impl<'a, S: Stage, C: LoadCell, A: SensorArray> Hand<'a, S, C, A> {
    /// Instruments that are prepared, with the zero taken; the axes are read back.
    pub fn new(
        instruments: Instruments<S, Gauge<'a, C>, A>,
        frame: Frame,
        usage: StageUse,
        timing: Timing,
        probe: Option<SceneProbe>,
        claims: Claims,
    ) -> Self {
        let Instruments { stage, load_cell: cell, array } = instruments;
        let air = vec![0.0; array.units()];
        let (place, z_mm) = (Place::default(), 0.0);
        Hand { stage, cell, array, frame, usage, timing, probe, air, place, z_mm, _claims: claims }
    }
}
