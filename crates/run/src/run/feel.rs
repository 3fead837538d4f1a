//! Finds the surface with the outputs of the array, on a rig without a load cell.

use super::Halt;
use super::without_cell::DepthRunner;
use palpate_control::{Expected, SafetyRule, Trip, depth_without_force_mm};
use palpate_core::quantity::{Axis, Place};

/// Step above the earliest surface by the frame, as a part of the depth that the force limit allows. If the frame is wrong, one step
/// reaches this part of the force limit.
const COARSE_SHARE: f64 = 0.4;

/// Step where the surface is expected: the same part, and the largest step, mm.
const FINE_SHARE: f64 = 0.02;
const FINE_MOST_MM: f64 = 0.02;

/// Number of steps in contact from which the beginning of the contact is extrapolated.
const IN_CONTACT: usize = 4;

/// Number of readings that must show a contact.
const LOOKS: usize = 2;

impl DepthRunner<'_> {
    /// Lowers z at a place in steps until the outputs leave their noise, and returns z of the surface, mm. The stage is in the clear again
    /// afterwards.
    ///
    /// Each step ends at most the depth that the force limit allows below the last place that was free, and below the earliest surface by
    /// the frame. So an array that feels nothing doesn't let the indenter press too hard, nor does a wrong frame. The outputs grow nearly
    /// in proportion to the depth, so the line through the first steps in contact is zero at the surface.
    pub(super) async fn feel_surface(&mut self, place: Place) -> Result<f64, Halt> {
        self.go_to(place).await?;
        let Expected { first_mm, last_mm, .. } = self.map.expect(place);
        let room_mm = depth_without_force_mm(&self.spec.limits);
        let fine_mm = (FINE_SHARE * room_mm).min(FINE_MOST_MM).max(self.spec.stage.steps.along(Axis::Z));
        let no_load = self.rig_control.outputs_at_rest().await?;
        let (most, mut free_mm) = (no_load.noise_most(), self.rig_control.z_mm);
        let mut rise: Vec<(f64, f64)> = Vec::new();
        while rise.len() < IN_CONTACT {
            let z_mm = self.rig_control.z_mm;
            let to_first_mm = self.permit.travel_mm(first_mm) - z_mm;
            let step_mm = if to_first_mm > fine_mm { (COARSE_SHARE * room_mm).min(to_first_mm) } else { fine_mm };
            let earliest_mm = first_mm.min(free_mm);
            let is_deeper = z_mm + step_mm <= self.permit.deepest_without_force_mm(earliest_mm);
            if !is_deeper && rise.len() > 1 {
                break;
            }
            if !is_deeper || (rise.is_empty() && z_mm > last_mm + room_mm) {
                return Err(Trip::new(SafetyRule::NoContact, z_mm, last_mm, "mm").into());
            }
            let speed_mm_s = self.spec.stage.approach_mm_s;
            let granted = self.permit.advance_without_force(earliest_mm, z_mm + step_mm, speed_mm_s)?;
            self.rig_control.move_z_unforced(granted).await?;
            let mut shown = self.rig_control.outputs_at_rest().await?.distance(&no_load.means);
            for _ in 1..LOOKS {
                if shown > most {
                    shown = shown.min(self.rig_control.outputs_at_rest().await?.distance(&no_load.means));
                }
            }
            match shown > most {
                true if self.rig_control.z_mm <= first_mm => {
                    return Err(Trip::new(SafetyRule::SurfaceElsewhere, self.rig_control.z_mm, first_mm, "mm").into());
                }
                true => rise.push((self.rig_control.z_mm, shown)),
                false => free_mm = self.rig_control.z_mm,
            }
        }
        self.clear(first_mm).await?;
        Ok(begins_mm(&rise).max(free_mm))
    }
}

/// Returns z at which the outputs began to rise, by the line through the steps in contact; at latest the first step.
fn begins_mm(rise: &[(f64, f64)]) -> f64 {
    let count = rise.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| rise.iter().map(of).sum::<f64>() / count;
    let (z_mm, shown) = (mean(|step| step.0), mean(|step| step.1));
    let spread: f64 = rise.iter().map(|step| (step.0 - z_mm).powi(2)).sum();
    let slope = rise.iter().map(|step| (step.0 - z_mm) * (step.1 - shown)).sum::<f64>() / spread;
    let first_mm = rise.first().map_or(f64::NAN, |step| step.0);
    if slope > 0.0 { (z_mm - shown / slope).min(first_mm) } else { first_mm }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surface_is_where_the_line_through_the_steps_is_zero() {
        assert!((begins_mm(&[(0.11, 0.2), (0.13, 0.6), (0.15, 1.0)]) - 0.10).abs() < 1e-12);
        assert_eq!(begins_mm(&[(0.11, 0.2), (0.13, 0.2)]), 0.11, "without a rise, the first step");
    }
}
