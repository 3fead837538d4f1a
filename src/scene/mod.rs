//! The physics of a simulated rig, pure: where the axes are, what the contact bears, what the load cell and the taxels read.
//!
//! A [`Scene`] is told the time and advances in closed form to it; it owns its random streams and nothing else that
//! changes. What a [`SceneSpec`] doesn't name isn't computed. Emulators act on it: they set motions and read values.

mod contact;
mod load_cell;
mod motion;
mod spec;
mod surface;
mod taxels;

pub use motion::Trajectory;
pub use spec::{Branch, Contact, Device, Elastomer, Latencies, LoadCell, SceneSpec, Setting};

use crate::quantity::{Axis, Stream, stream};
use contact::ContactState;
use load_cell::LoadCellState;
use rand::RngExt;
use surface::Surface;
use taxels::TaxelState;

/// What really happened in a press, as no instrument of the rig can know it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Mean of the true contact force at the load cell's conversions in the window, N.
    pub force_true_n: f64,
    /// The largest true force since the truth was last taken, N.
    pub force_peak_n: f64,
    /// The deepest indentation below the true surface since the truth was last taken, mm.
    pub depth_peak_mm: f64,
}

/// A simulated specimen under a simulated indenter, at one moment.
pub struct Scene {
    setting: Setting,
    seed: u64,
    now_s: f64,
    axes: [Trajectory; 3],
    surface: Surface,
    contact: ContactState,
    load_cell: LoadCellState,
    taxels: TaxelState,
    latency: [Stream; 3],
    window: Option<WindowMean>,
    window_force_n: f64,
}

#[derive(Default)]
struct WindowMean {
    sum_n: f64,
    count: usize,
}

impl Scene {
    /// A scene at time 0, the axes at rest where the controller was switched on; `seed` decides the specimen and all noise.
    pub fn new(spec: SceneSpec, setting: Setting, seed: u64) -> Self {
        let power_on = setting.power_on;
        let axes = Axis::ALL.map(|axis| Trajectory::at_rest(power_on.along(axis)));
        let surface = Surface::tilted(&setting.frame, spec.surface_tilt_mm, setting.half_extent_mm, seed);
        let mut scene = Scene {
            seed,
            now_s: 0.0,
            axes,
            surface,
            contact: ContactState::new(spec.contact, spec.relaxation),
            load_cell: LoadCellState::new(spec.load_cell, setting.conversions_hz),
            taxels: TaxelState::new(spec.elastomer, spec.taxel_noise_percent, spec.hysteresis_percent, &setting),
            latency: Device::ALL.map(|device| stream(seed, 0, device.name())),
            setting: Setting { latencies: spec.latencies, ..setting },
            window: None,
            window_force_n: 0.0,
        };
        scene.reseed(0);
        scene
    }

    /// Names the press that comes next: from here on every stream is that press' own, whatever came before.
    pub fn begin_press(&mut self, press: u64) {
        self.reseed(press + 1); // 0 is what happens before the first press
        self.contact.forget_peaks();
    }

    /// Where an axis is and how fast it moves at `now_s`, in the stage frame: (mm, mm/s).
    pub fn axis(&mut self, axis: Axis, now_s: f64) -> (f64, f64) {
        self.advance(now_s);
        let trajectory = &self.axes[axis.index()];
        (trajectory.position_mm(now_s), trajectory.speed_mm_s(now_s))
    }

    /// The motion an axis is on.
    pub fn motion(&self, axis: Axis) -> &Trajectory {
        &self.axes[axis.index()]
    }

    /// Puts an axis on a new motion from `now_s` on. The trajectory must start where the axis is.
    pub fn set_motion(&mut self, axis: Axis, trajectory: Trajectory, now_s: f64) {
        self.advance(now_s);
        self.axes[axis.index()] = trajectory;
        if axis != Axis::Z && !self.contact.touching() {
            self.contact.forget_load(); // another spot knows nothing of what this one bore
        }
    }

    /// The last conversion of the load cell at `now_s`, N: pressing positive, noise included, no zero taken.
    pub fn load_cell_n(&mut self, now_s: f64) -> f64 {
        self.advance(now_s);
        let (fresh, true_n, read_n) = self.load_cell.read();
        if let (true, Some(window)) = (fresh, self.window.as_mut()) {
            window.sum_n += true_n;
            window.count += 1;
        }
        read_n
    }

    /// The outputs of all taxels at `now_s`, in units of the reading for 1 N straight above, written to `outputs`.
    ///
    /// # Panics
    /// If `outputs` doesn't have one place a taxel.
    pub fn outputs(&mut self, now_s: f64, outputs: &mut [f64]) {
        self.advance(now_s);
        self.taxels.outputs(self.contact.force_n(), self.place(now_s), outputs);
    }

    /// How many taxels the array has.
    pub fn taxels(&self) -> usize {
        self.setting.layout.len()
    }

    /// How long a device takes over its next request, s.
    pub fn latency_s(&mut self, device: Device) -> f64 {
        let (least, most) = self.setting.latencies.of(device);
        self.latency[device as usize].random_range(least..=most)
    }

    /// The true contact force at `now_s`, N.
    pub fn true_force_n(&mut self, now_s: f64) -> f64 {
        self.advance(now_s);
        self.contact.force_n()
    }

    /// Begins to average the true force at the load cell's conversions.
    pub fn open_window(&mut self, now_s: f64) {
        self.advance(now_s);
        self.window = Some(WindowMean::default());
    }

    /// Ends the average that [`open_window`](Self::open_window) began; with no conversion in it, the force of this moment.
    pub fn close_window(&mut self, now_s: f64) {
        self.advance(now_s);
        if let Some(window) = self.window.take() {
            let force_n = self.contact.force_n();
            self.window_force_n = if window.count == 0 { force_n } else { window.sum_n / window.count as f64 };
        }
    }

    /// What really happened since this was last asked (or since the press began): the window's mean and the worst.
    pub fn take_truth(&mut self, now_s: f64) -> Truth {
        self.advance(now_s);
        let (force_peak_n, depth_peak_mm) = self.contact.peaks();
        self.contact.forget_peaks();
        Truth { force_true_n: self.window_force_n, force_peak_n, depth_peak_mm }
    }

    fn reseed(&mut self, press: u64) {
        self.latency = Device::ALL.map(|device| stream(self.seed, press, device.name()));
        self.load_cell.reseed(stream(self.seed, press, "load cell noise"));
        self.taxels.reseed(stream(self.seed, press, "taxel noise"));
    }

    /// Moves the physics on to `to_s`, stopping at every instant at which something changes its law.
    fn advance(&mut self, to_s: f64) {
        while self.now_s < to_s {
            let until_s = self.next_knot(to_s);
            self.advance_smooth(until_s);
            self.now_s = until_s;
            self.load_cell.latch(self.now_s, self.contact.force_n());
        }
    }

    /// The next instant at which an axis changes its acceleration, or the last conversion of the load cell before
    /// `to_s` happens; at the latest `to_s`.
    fn next_knot(&self, to_s: f64) -> f64 {
        let conversion_s = self.load_cell.last_conversion_before(to_s);
        let knots = self.axes.iter().filter_map(|axis| axis.next_knot(self.now_s)).chain([conversion_s]);
        knots.filter(|&knot_s| knot_s > self.now_s).fold(to_s, f64::min)
    }

    /// One stretch in which all axes keep their accelerations: the depth is a quadratic in time.
    fn advance_smooth(&mut self, until_s: f64) {
        let [x, y, z] = self.axes.each_ref().map(|axis| axis.state(self.now_s));
        let depth = self.surface.depth(x, y, z);
        let was_touching = self.contact.touching();
        let before_n = self.contact.force_n();
        self.contact.advance(depth, until_s - self.now_s);
        if self.contact.touching() && !was_touching {
            self.taxels.touch();
        }
        self.taxels.follow(before_n, self.contact.force_n(), self.contact.touching());
    }

    fn place(&self, now_s: f64) -> crate::quantity::Place {
        let [x, y, _] = self.axes.each_ref().map(|axis| axis.position_mm(now_s));
        self.setting.frame.place_from_stage(x, y)
    }
}

#[cfg(test)]
mod tests;
