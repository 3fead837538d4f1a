//! What really happened in a press.

/// Longest stretch of a window that is taken for a trapezoid, s: what relaxes bends by some 1 uN within it.
const STRETCH_S: f64 = 0.005;

/// What really happened in a press, as no instrument of the rig can know it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Mean over time of the true contact force in the window, N.
    pub force_true_n: f64,
    /// The largest true force since the truth was last taken, N.
    pub force_peak_n: f64,
    /// The deepest indentation below the true surface since the truth was last taken, mm.
    pub depth_peak_mm: f64,
    /// The way made sideways while the tip was in contact since the truth was last taken, mm: 0 if all is right.
    pub slid_mm: f64,
}

/// Follows the true force for a window's mean, and the way slid.
#[derive(Clone, Default)]
pub(super) struct Witness {
    window: Option<Window>,
    window_mean_n: f64,
    slid_mm: f64,
}

#[derive(Clone, Copy, Default)]
struct Window {
    area_n_s: f64,
    for_s: f64,
}

impl Witness {
    /// Where the scene must stop after `now_s` at the latest, s: often while a window is open.
    pub fn next_knot(&self, now_s: f64) -> f64 {
        if self.window.is_some() { now_s + STRETCH_S } else { f64::INFINITY }
    }

    /// The force went from one value to another in `dt_s`: a trapezoid.
    pub fn follow(&mut self, dt_s: f64, from_n: f64, to_n: f64) {
        if let Some(window) = &mut self.window {
            window.area_n_s += dt_s * (from_n + to_n) / 2.0;
            window.for_s += dt_s;
        }
    }

    pub fn slide(&mut self, way_mm: f64) {
        self.slid_mm += way_mm;
    }

    pub fn open_window(&mut self) {
        self.window = Some(Window::default());
    }

    /// A window of no length has the force of this moment for its mean.
    pub fn close_window(&mut self, now_n: f64) {
        if let Some(Window { area_n_s, for_s }) = self.window.take() {
            self.window_mean_n = if for_s > 0.0 { area_n_s / for_s } else { now_n };
        }
    }

    /// The truth, with the contact's peaks: N and mm.
    pub fn take(&mut self, (force_peak_n, depth_peak_mm): (f64, f64)) -> Truth {
        let slid_mm = std::mem::take(&mut self.slid_mm);
        Truth { force_true_n: self.window_mean_n, force_peak_n, depth_peak_mm, slid_mm }
    }
}
