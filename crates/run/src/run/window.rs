//! Readings averaged over a window.

use super::Halt;
use super::air::side_mean;
use super::late::Late;
use super::retraction::then_notify;
use super::rig_control::RigControl;
use palpate_control::{Mean, STALE_S, mean_of};
use palpate_link::device::{DeviceError, DeviceProblem, LoadCell, SensorArray, Stage};
use palpate_link::time::{Instant, sleep_until};
use std::cell::Cell;
use std::time::Duration;
use tokio::sync::Notify;

/// Least number of readings in a window of any duration.
const READINGS_LEAST: u32 = 2;
/// Least interval between readings of the outputs. Changes of taxels within a window are slower.
const OUTPUTS_EVERY: Duration = Duration::from_millis(5);

/// Number of forces that are averaged at the end of a time for which a level was followed.
const FOLLOWED_READINGS: u32 = 20;

/// Fraction of the range from which an output may be beyond the end of the range.
const FULL_SCALE: f64 = 0.999;

/// Means of the outputs, updated as the outputs are read.
#[derive(Clone, Debug, Default)]
pub(super) struct OutputMeans {
    pub means: Vec<f64>,
    pub readings: u32,
    /// Sums of the squares of the readings' differences from their mean.
    squares: Vec<f64>,
}

impl OutputMeans {
    /// Adds one reading of all outputs. If all readings are equal, the mean equals them exactly, to the last bit.
    pub(super) fn take(&mut self, outputs: &[f64]) {
        self.means.resize(outputs.len(), 0.0);
        self.squares.resize(outputs.len(), 0.0);
        self.readings += 1;
        let share = 1.0 / f64::from(self.readings);
        for ((mean, square), output) in self.means.iter_mut().zip(&mut self.squares).zip(outputs) {
            let off = output - *mean;
            *mean += off * share;
            *square += off * (output - *mean);
        }
    }

    /// Adds readings one by one, no faster than outputs change, while `goes_on` and until `over` is notified. It adds no reading
    /// before `begins`. `check` checks every reading, with its duration.
    pub(super) async fn take_while<A: SensorArray>(
        &mut self,
        array: &mut A,
        over: &Notify,
        begins: impl Fn() -> bool,
        goes_on: impl Fn(u32) -> bool,
        mut check: impl FnMut(&[f64], Duration) -> Result<(), DeviceError>,
    ) -> Result<(), Halt> {
        let mut now = vec![0.0; array.units()];
        while goes_on(self.readings) {
            let asked = Instant::now();
            if begins() {
                let read = array.read(&mut now).await;
                read.and_then(|()| check(&now, asked.elapsed())).map_err(Halt::unread)?;
                self.take(&now);
            }
            tokio::select! {
                biased;
                () = over.notified() => break,
                () = sleep_until(asked + OUTPUTS_EVERY) => {}
            }
        }
        Ok(())
    }

    /// Standard deviation of one reading of each output.
    pub(super) fn sigmas(&self) -> Vec<f64> {
        self.squares.iter().map(|square| (square / f64::from(self.readings.max(2) - 1)).sqrt()).collect()
    }
}

/// Result of a window.
#[derive(Clone, Debug)]
pub(super) struct MeasuredWindow {
    /// Time when the window began.
    pub began: Instant,
    /// Mean force, N relative to the reading without load before.
    pub force_n: f64,
    /// Mean forces along x and y, N relative to the readings without load before; `None` for a cell with one axis.
    pub side_n: Option<[f64; 2]>,
    /// Middle of the forces, s by the press' clock.
    pub middle_s: f64,
    /// Number of forces, and their duration, s.
    pub forces: u32,
    pub seconds: f64,
    /// Mean outputs minus the outputs without load, in the array's unit.
    pub outputs: Vec<f64>,
    /// Whether an output was at the end of its range.
    pub saturated: bool,
    /// Whether the outputs delayed the window by more than the allowed age of a reading.
    pub late: bool,
}

impl MeasuredWindow {
    /// Whether the array can't have measured this contact: no unit has changed since the reading without load before, or since another
    /// contact.
    pub(super) fn is_frozen(&self, before: Option<&[f64]>) -> bool {
        self.outputs.iter().all(|output| *output == 0.0) || before == Some(&self.outputs)
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Samples force and outputs together for `seconds`, or for complete periods of the mains interference, with z at rest. An output that
    /// is not a number is a failure of the array. An output at the end of the array's range, `range_v`, is noted.
    pub(super) async fn sample(&mut self, seconds: f64, range_v: Option<f64>) -> Result<MeasuredWindow, Halt> {
        self.cell.settle().await?;
        let began = Instant::now();
        let has_mains = self.cell.watch.zero().mains.is_some();
        // two additional readings, so that the whole periods are within
        let seconds = if has_mains { self.cell.whole_s(seconds) + 2.0 * self.timing.conversion_s } else { seconds };
        let until = began + Duration::from_secs_f64(seconds);
        self.truth.open_window();
        self.series.iter().for_each(|series| series.window(true));
        let mut means = OutputMeans::default();
        let (mut saturated, mut late) = (false, false);
        // the cell shows a force later, by its lag: these readings belong to the time of the outputs
        let lag = Duration::from_secs_f64(self.timing.lag_s);
        // each at its own speed: neither waits for the other
        let (watched_cell, array) = (&mut self.cell, &mut self.array);
        let (over, late_outputs) = (Notify::new(), Late::default());
        let forces = async {
            let mut read: Vec<(f64, f64)> = Vec::new();
            let mut sides: Vec<Option<[f64; 2]>> = Vec::new();
            while Instant::now() < until + lag || read.len() < READINGS_LEAST as usize {
                match watched_cell.force_n().await {
                    Ok(force_n) if Instant::now() > began + lag => {
                        read.push((watched_cell.now_s(), force_n));
                        sides.push(watched_cell.side_n);
                    }
                    Ok(_) => {}
                    Err(halt) => {
                        over.notify_one(); // a lost window isn't completed
                        late_outputs.give_up_soon().await;
                        return Err(halt);
                    }
                }
            }
            watched_cell.watch_while(&late_outputs).await?;
            Ok::<_, Halt>((mean_of(&read, watched_cell.watch.zero()), side_mean(sides.into_iter())))
        };
        let goes_on = |readings| Instant::now() < until || readings < READINGS_LEAST;
        let check = |now: &[f64], took: Duration| {
            late |= took.as_secs_f64() > STALE_S;
            saturated |= is_saturated(now, range_v)?;
            Ok(())
        };
        let truth = &self.truth;
        let outputs = async {
            let taken = means.take_while(array, &over, || true, goes_on, check);
            let outputs = late_outputs.ends(taken).await;
            truth.close_window();
            outputs.unwrap_or(Ok(())) // given up only where the force has halted
        };
        let (force, outputs) = tokio::join!(forces, outputs);
        self.series.iter().for_each(|series| series.window(false));
        let (force, side_n) = force?;
        outputs?;
        let Mean { value: force_n, middle_s, readings: forces } =
            force.unwrap_or(Mean { value: f64::NAN, middle_s: 0.0, readings: 0 });
        let outputs = means.means.iter().zip(&self.no_load).map(|(mean, no_load)| mean - no_load).collect();
        Ok(MeasuredWindow { began, force_n, side_n, middle_s, forces, seconds, outputs, saturated, late })
    }
}

impl<S: Stage, C: LoadCell, A: SensorArray> RigControl<'_, S, C, A> {
    /// Reads all devices at rest for `seconds`, each as fast as its link allows. Returns the mean of the forces at the end, N relative to
    /// the reading without load before.
    pub(super) async fn follow(&mut self, seconds: f64) -> Result<f64, Halt> {
        self.cell.settle().await?;
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        self.series.iter().for_each(|series| series.window(true));
        let at_rest = self.at_rest();
        let (stage, watched_cell, array) = (&mut self.stage, &mut self.cell, &mut self.array);
        let (failed, over, late) = (Cell::new(false), Notify::new(), Late::default());
        let forces = async {
            while Instant::now() < until && !failed.get() {
                if let Err(halt) = watched_cell.force_n().await {
                    failed.set(true);
                    late.give_up_soon().await;
                    return Err(halt);
                }
            }
            watched_cell.watch_while(&late).await
        };
        let forces = then_notify(forces, &over);
        let rests = async { at_rest.asked(stage, until, &over, &failed).await.inspect_err(|_| failed.set(true)) };
        let outputs = async {
            let mut now = vec![0.0; array.units()];
            while Instant::now() < until && !failed.get() {
                let read = array.read(&mut now).await.and_then(|()| is_saturated(&now, None));
                read.inspect_err(|_| failed.set(true)).map_err(Halt::unread)?;
            }
            Ok::<(), Halt>(())
        };
        let (forces, outputs, rests) = tokio::join!(forces, late.ends(outputs), rests);
        self.series.iter().for_each(|series| series.window(false));
        forces?;
        outputs.unwrap_or(Ok(()))?; // given up only where the force has halted
        rests?;
        self.cell.mean_n(FOLLOWED_READINGS).await
    }
}

/// Whether any output is at the end of the range.
pub(super) fn is_saturated(outputs: &[f64], range_v: Option<f64>) -> Result<bool, DeviceError> {
    if let Some((unit, output)) = (1..).zip(outputs).find(|(_, output)| !output.is_finite()) {
        let (answer, expected) = (format!("{output} from unit {unit}"), "a number from every unit".to_owned());
        let (device, doing) = ("array".to_owned(), "sampling the outputs".to_owned());
        return Err(DeviceError { device, doing, problem: DeviceProblem::Misfit { answer, expected } });
    }
    Ok(range_v.is_some_and(|range_v| outputs.iter().any(|output| output.abs() >= FULL_SCALE * range_v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_at_the_end_of_its_range_is_flagged_and_nan_is_refused() {
        assert!(is_saturated(&[0.1, -9.995], Some(10.0)).unwrap());
        assert!(!is_saturated(&[0.1, -9.9], Some(10.0)).unwrap() && !is_saturated(&[99.0], None).unwrap());
        for output in [f64::NAN, f64::INFINITY] {
            let text = is_saturated(&[0.1, output], None).unwrap_err().to_string();
            assert!(text.contains("from unit 2"), "{text}");
        }
    }

    #[test]
    fn outputs_that_never_change_are_flagged() {
        let window = |outputs: Vec<f64>| {
            let (force_n, middle_s) = (1.0, 0.0);
            MeasuredWindow {
                began: Instant::now(),
                force_n,
                side_n: None,
                middle_s,
                forces: 40,
                seconds: 0.2,
                outputs,
                saturated: false,
                late: false,
            }
        };
        assert!(window(vec![0.0, 0.0]).is_frozen(None), "as without load");
        assert!(window(vec![0.2, 0.1]).is_frozen(Some(&[0.2, 0.1])), "as in the contact before");
        assert!(!window(vec![0.2, 0.1]).is_frozen(Some(&[0.2, 0.1001])) && !window(vec![0.0, 0.1]).is_frozen(None));
    }
}
