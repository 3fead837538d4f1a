//! The instruments in use.

use super::Halt;
use super::no_load_outputs::NoLoadOutputs;
use super::series::{RecordedDevice, SeriesRecorder};
use super::watched_cell::WatchedLoadCell;
use super::window::OutputMeans;
use crate::rig::{AdjustedCell, ArraySpec, GroundTruth};
use palpate_control::{SafetyRule, Timing, Trip};
use palpate_core::quantity::{Frame, Place};
use palpate_data::dataset::{NoLoad, PressTruth};
use palpate_drivers::{AnyArray, AnyStage};
use palpate_link::device::{Instruments, LoadCell, SensorArray, Stage, StageUse};
use palpate_link::wire::Claims;
use std::cmp::Ordering::{Equal, Less};
use std::rc::Rc;
use tokio::sync::Notify;

/// Largest change of an output between two looks of the first descent, in sd of a reading. The other constants allow for a
/// converter's steps and a slow drift, as fractions of the array's range, or of the output if the range is unknown.
const OUTPUT_SIGMAS: f64 = 10.0;
const RANGE_SHARE: f64 = 5e-4;
const OUTPUT_SHARE: f64 = 1e-3;
/// Number of successive readings that must show such a change.
pub(super) const OUTPUT_LOOKS: usize = 3;
/// Number of force readings that detect a light touch, and least mean above zero, in sd.
pub(super) const LIGHT_READINGS: u32 = 20;
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
        self.cell.watch.pause(); // the array may have taken longer
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

    /// Standard deviation of one reading of each output without load.
    pub(super) fn no_load_sigmas(&self) -> &[f64] {
        &self.no_load_sigmas
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
