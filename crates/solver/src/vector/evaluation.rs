//! Errors of solved force vectors.

use super::{Shear, VectorMap, VectorRow, VectorWorkspace};
use serde::Serialize;

/// Factor of a one-sigma error that 95 % of normal errors don't exceed.
const SIGMAS_95: f64 = 1.96;

/// Errors of a force vector and its place on test presses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VectorErrors {
    /// Number of presses that have an answer.
    pub presses: usize,
    /// Number of presses without one.
    pub unsolved: usize,
    /// Number of answers that the outputs don't determine the force along the surface.
    pub shear_not_determinable: usize,
    /// Mean and 95th percentile of the distance from the true place, mm.
    pub location_mm: [f64; 2],
    /// Mean and 95th percentile of the error of the pressing force, N.
    pub press_n: [f64; 2],
    /// Mean and 95th percentile of the length of the error of the force along the surface, N; `None` if it is never stated.
    pub shear_n: Option<[f64; 2]>,
    /// Shares of the errors of x, y, and the forces along x, y and the press within the stated 68 % and 95 %.
    pub within: [[f64; 2]; 5],
}

impl VectorErrors {
    /// Solves test presses. `None` if none has an answer.
    pub fn of<'a>(map: &VectorMap, rows: impl Iterator<Item = VectorRow<'a>>) -> Option<VectorErrors> {
        let mut workspace = VectorWorkspace::default();
        let (mut location_mm, mut press_n, mut shear_n, mut unsolved) = (Vec::new(), Vec::new(), Vec::new(), 0);
        let mut within = [[0usize; 3]; 5];
        for VectorRow { place, force_n, outputs } in rows {
            let Ok(contact) = map.solve(outputs, &mut workspace) else {
                unsolved += 1;
                continue;
            };
            let off_mm = [contact.place.x_mm - place.x_mm, contact.place.y_mm - place.y_mm];
            let off_press_n = contact.press_n - force_n[2];
            location_mm.push(off_mm[0].hypot(off_mm[1]));
            press_n.push(off_press_n.abs());
            let mut errors = vec![(0, off_mm[0]), (1, off_mm[1]), (4, off_press_n)];
            if let Shear::Force([x_n, y_n]) = contact.shear {
                let off_n = [x_n - force_n[0], y_n - force_n[1]];
                shear_n.push(off_n[0].hypot(off_n[1]));
                errors.extend([(2, off_n[0]), (3, off_n[1])]);
            }
            let sd = contact.covariance.sd();
            for (component, error) in errors {
                let [count, in_68, in_95] = &mut within[component];
                *count += 1;
                *in_68 += usize::from(error.abs() <= sd[component]);
                *in_95 += usize::from(error.abs() <= SIGMAS_95 * sd[component]);
            }
        }
        let presses = location_mm.len();
        let share = |[count, in_68, in_95]: [usize; 3]| [in_68, in_95].map(|n| n as f64 / count.max(1) as f64);
        Some(VectorErrors {
            presses,
            unsolved,
            shear_not_determinable: presses - shear_n.len(),
            location_mm: summary(location_mm)?,
            press_n: summary(press_n)?,
            shear_n: summary(shear_n),
            within: within.map(share),
        })
    }
}

/// Returns the mean and the 95th percentile.
fn summary(mut errors: Vec<f64>) -> Option<[f64; 2]> {
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    errors.get(errors.len() * 95 / 100).map(|p95| [mean, *p95])
}
