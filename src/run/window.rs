use super::Halt;
use super::hand::Hand;
use crate::device::{LoadCell, SensorArray, Stage};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep_until};

/// Fewest readings in a window, however short it is.
const READINGS_LEAST: u32 = 2;
/// The outputs are read no more often than that: what taxels do in a window is slower.
const OUTPUTS_EVERY: Duration = Duration::from_millis(5);

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
        self.cell.settle().await?;
        let began = Instant::now();
        let until = began + Duration::from_secs_f64(seconds);
        if let Some(probe) = &self.probe {
            probe.open_window();
        }
        let mut sums = vec![0.0; self.array.units()];
        let mut now = sums.clone();
        // each as fast as it goes: neither waits for the other
        let (gauge, array) = (&mut self.cell, &mut self.array);
        let over = Notify::new();
        let forces = async {
            let (mut sum_n, mut readings) = (0.0, 0);
            while Instant::now() < until || readings < READINGS_LEAST {
                match gauge.force_n().await {
                    Ok(force_n) => sum_n += force_n,
                    Err(halt) => {
                        over.notify_one(); // nothing of a window is waited for that is lost
                        return Err(halt);
                    }
                }
                readings += 1;
            }
            Ok::<f64, Halt>(sum_n / f64::from(readings))
        };
        let outputs = async {
            let mut readings = 0;
            while Instant::now() < until || readings < READINGS_LEAST {
                let next = Instant::now() + OUTPUTS_EVERY;
                array.read(&mut now).await?;
                sums.iter_mut().zip(&now).for_each(|(sum, output)| *sum += output);
                readings += 1;
                tokio::select! {
                    biased;
                    () = over.notified() => break,
                    () = sleep_until(next) => {}
                }
            }
            Ok::<f64, Halt>(f64::from(readings))
        };
        let (force_n, readings) = tokio::join!(forces, outputs);
        let (force_n, count) = (force_n?, readings?);
        if let Some(probe) = &self.probe {
            probe.close_window();
        }
        let outputs = sums.iter().zip(&self.air).map(|(sum, air)| sum / count - air).collect();
        Ok(Window { began, force_n, outputs })
    }
}
