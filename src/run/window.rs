use super::Halt;
use super::hand::Hand;
use crate::device::{LoadCell, SensorArray, Stage};
use std::time::Duration;
use tokio::time::Instant;

/// Fewest readings in a window, however short it is.
const READINGS_LEAST: u32 = 2;

/// What a window came to.
#[derive(Clone, Debug)]
pub(super) struct Window {
    /// When it began.
    pub began: Instant,
    /// Mean force, N from the zero.
    pub force_n: f64,
    /// Mean outputs, less those in air, V.
    pub outputs: Vec<f64>,
}

impl<S: Stage, C: LoadCell, A: SensorArray> Hand<'_, S, C, A> {
    /// Samples force and outputs together for so long, z at rest.
    pub async fn sample(&mut self, seconds: f64) -> Result<Window, Halt> {
        let began = Instant::now();
        let until = began + Duration::from_secs_f64(seconds);
        if let Some(probe) = &self.probe {
            probe.open_window();
        }
        let mut now = vec![0.0; self.array.units()];
        let mut sums = vec![0.0; now.len()];
        let (mut force_sum_n, mut readings) = (0.0, 0);
        while Instant::now() < until || readings < READINGS_LEAST {
            self.cell.due().await?;
            let (reading, outputs) = tokio::join!(self.cell.cell.read(), self.array.read(&mut now));
            force_sum_n += self.cell.watched(&reading?)?;
            outputs?;
            sums.iter_mut().zip(&now).for_each(|(sum, output)| *sum += output);
            readings += 1;
        }
        if let Some(probe) = &self.probe {
            probe.close_window();
        }
        let count = f64::from(readings);
        let outputs = sums.iter().zip(&self.air).map(|(sum, air)| sum / count - air).collect();
        Ok(Window { began, force_n: force_sum_n / count, outputs })
    }
}
