//! True events of a press.

/// Longest stretch of a window that is approximated by a trapezoid, s. Relaxation deviates from a straight line by some 1 uN
/// within it.
const STRETCH_S: f64 = 0.005;

/// True events of a press, which no instrument of the rig can measure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Mean of the true contact force over the time of the window, N.
    pub force_true_n: f64,
    /// Largest true force since the truth was last read, N.
    pub force_peak_n: f64,
    /// Deepest indentation below the true surface since the truth was last read, mm.
    pub depth_peak_mm: f64,
    /// Sideways distance in contact since the truth was last read, mm; 0 if there is no error.
    pub slid_mm: f64,
    /// Largest true force sideways since the truth was last read, N.
    pub shear_peak_n: f64,
    /// Largest length of the whole true force since the truth was last read, N.
    pub length_peak_n: f64,
}

/// Records the true force for a window's mean, and the distance slid.
#[derive(Clone, Default)]
pub(super) struct Witness {
    window: Option<TrueWindow>,
    window_mean_n: f64,
    slid_mm: f64,
    /// Squares of the largest force sideways and of the largest length of the whole force, N^2.
    peaks_n2: [f64; 2],
}

#[derive(Clone, Copy, Default)]
struct TrueWindow {
    area_n_s: f64,
    for_s: f64,
}

impl Witness {
    /// Latest time at which the scene must stop after `now_s`, s. It stops often while a window is open.
    pub(super) fn next_knot(&self, now_s: f64) -> f64 {
        if self.window.is_some() { now_s + STRETCH_S } else { f64::INFINITY }
    }

    /// Takes a change of the force from one value to another in `dt_s`, treated as a trapezoid.
    pub(super) fn follow(&mut self, dt_s: f64, from_n: f64, to_n: f64) {
        if let Some(window) = &mut self.window {
            window.area_n_s += dt_s * (from_n + to_n) / 2.0;
            window.for_s += dt_s;
        }
    }

    /// Takes a force sideways and a force along z, N.
    pub(super) fn press(&mut self, side_n: [f64; 2], force_n: f64) {
        let shear_n2 = side_n[0] * side_n[0] + side_n[1] * side_n[1];
        let [shear_most_n2, length_most_n2] = self.peaks_n2;
        self.peaks_n2 = [shear_most_n2.max(shear_n2), length_most_n2.max(shear_n2 + force_n * force_n)];
    }

    pub(super) fn slide(&mut self, way_mm: f64) {
        self.slid_mm += way_mm;
    }

    pub(super) fn open_window(&mut self) {
        self.window = Some(TrueWindow::default());
    }

    /// Closes the window. The mean of a window without duration is the force of this moment.
    pub(super) fn close_window(&mut self, now_n: f64) {
        if let Some(TrueWindow { area_n_s, for_s }) = self.window.take() {
            self.window_mean_n = if for_s > 0.0 { area_n_s / for_s } else { now_n };
        }
    }

    /// Returns the truth, with the contact's peaks: N and mm.
    pub(super) fn take(&mut self, (force_peak_n, depth_peak_mm): (f64, f64)) -> Truth {
        let slid_mm = std::mem::take(&mut self.slid_mm);
        let [shear_peak_n, length_peak_n] = std::mem::take(&mut self.peaks_n2).map(f64::sqrt);
        Truth { force_true_n: self.window_mean_n, force_peak_n, depth_peak_mm, slid_mm, shear_peak_n, length_peak_n }
    }
}
