use super::{Cancel, Halt};
use crate::control::{Trip, Watch};
use crate::device::{Instruments, LoadCell, SensorArray, Stage, StageUse};
use crate::quantity::{Frame, Place};
use crate::rig::SceneProbe;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// The instruments in use: what carries out the commands of a press.
pub(super) struct Hand<'a, S, C, A> {
    pub stage: S,
    pub cell: Gauge<'a, C>,
    pub array: A,
    pub frame: Frame,
    pub usage: StageUse,
    pub probe: Option<SceneProbe>,
    /// The outputs in air.
    pub air: Vec<f64>,
    /// Where the indenter is: specimen frame, read back.
    pub place: Place,
    pub z_mm: f64,
}

/// The load cell under its watch, read no faster than it converts.
pub(super) struct Gauge<'a, C> {
    pub cell: C,
    pub watch: Watch,
    pub cancel: &'a Cancel,
    /// Told of every force, for a person to see.
    pub shown: &'a dyn Fn(f64),
    next: Instant,
    last: Option<Instant>,
}

impl<'a, C: LoadCell> Gauge<'a, C> {
    pub fn new(cell: C, watch: Watch, cancel: &'a Cancel, shown: &'a dyn Fn(f64)) -> Self {
        Gauge { cell, watch, cancel, shown, next: Instant::now(), last: None }
    }

    /// Waits for the cell's next conversion to be due.
    pub async fn due(&mut self) -> Result<(), Halt> {
        if self.cancel.asked() {
            return Err(Halt::Cancelled);
        }
        let now = Instant::now();
        if self.next > now {
            sleep_until(self.next).await;
        }
        self.next = self.next.max(now) + self.cell.conversion();
        Ok(())
    }

    /// The next force, N from the zero; every reading passes the trip rules.
    pub async fn force_n(&mut self) -> Result<f64, Halt> {
        self.due().await?;
        let reading = self.cell.read().await?;
        Ok(self.watched(&reading)?)
    }

    /// A reading's force, N from the zero.
    pub fn watched(&mut self, reading: &crate::quantity::ForceReading) -> Result<f64, Trip> {
        let force_n = self.watch.force_n(reading)?;
        (self.shown)(force_n);
        self.last = Some(Instant::now());
        Ok(force_n)
    }

    /// How old the last good reading is, s.
    pub fn age_s(&self) -> f64 {
        self.last.map_or(f64::INFINITY, |last| last.elapsed().as_secs_f64())
    }

    /// The mean of some readings, N from the zero.
    pub async fn mean_n(&mut self, readings: u32) -> Result<f64, Halt> {
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

impl<'a, S: Stage, C: LoadCell, A: SensorArray> Hand<'a, S, C, A> {
    /// Instruments that are prepared, with the zero taken; the axes are read back.
    pub fn new(
        instruments: Instruments<S, Gauge<'a, C>, A>,
        frame: Frame,
        usage: StageUse,
        probe: Option<SceneProbe>,
        air: Vec<f64>,
    ) -> Self {
        let Instruments { stage, load_cell: cell, array } = instruments;
        Hand { stage, cell, array, frame, usage, probe, air, place: Place::default(), z_mm: 0.0 }
    }
}
