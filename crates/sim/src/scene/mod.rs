//! Physics of a simulated rig, as pure code: axis positions, contact force, and the readings of load cell and taxels.
//!
//! A [`Scene`] is given the time and advances to it in closed form. It owns its random streams and depends on nothing else that
//! changes. Terms that a [`SceneSpec`] doesn't name aren't computed. Emulators act on the scene: they set motions and read
//! values.

mod advance;
mod backlash;
mod contact;
mod creep;
mod faults;
mod friction;
mod glitches;
mod load_cell;
mod monitored;
mod motion;
mod skin;
mod spec;
mod spots;
mod surface;
mod taxels;
mod temperature;
mod truth;
mod weight;

pub use faults::{FaultKind, SceneFault};
pub use friction::Friction;
pub use glitches::{CorruptSamples, GlitchKind};
pub use monitored::Monitored;
pub use motion::Trajectory;
pub use skin::{
    Converter, Elastomer, NoiseOf, SKIN_CHANNELS_MAX, Skin, SkinSpec, TaxelFault, TaxelFaultKind, TaxelNoise, Taxels,
};
pub use spec::{
    ContactLaw, Edges, Latencies, LoadCellScene, Mounting, RelaxationBranch, Relief, SceneDevice, SceneSpec, Servo,
    SideAxes, Sine, Spikes, Stiffness, Surroundings, Wear,
};
pub use temperature::Temperature;
pub use truth::Truth;

use backlash::Backlash;
use contact::ContactState;
use faults::SceneFaults;
use friction::FrictionState;
use load_cell::LoadCellState;
use palpate_core::quantity::{Axis, Place, RandomStream, stream};
use rand::RngExt;
use spots::SpotMap;
use surface::Surface;
use taxels::TaxelState;
use truth::Witness;
use weight::Weight;

/// Wavelengths of the smooth part of a stiffness map, mm.
const STIFFNESS_WAVELENGTH_MM: (f64, f64) = (6.0, 12.0);

/// Value added before rounding down to a step of the stage. The excess over one half is larger than the rounding of numbers. So a
/// target midway between two steps always goes to the same side, and equal distances give equal numbers of steps.
const HALF: f64 = 0.5 + 1e-6;

/// A simulated specimen under a simulated indenter, at one moment. A copy continues independently.
#[derive(Clone)]
pub struct Scene {
    setting: Surroundings,
    seed: u64,
    now_s: f64,
    /// Motions of the axes as planned by the controller.
    profiles: [Trajectory; 3],
    /// Actual motions of the axes.
    axes: [Trajectory; 3],
    servo: Servo,
    /// Play of z.
    backlash: Option<Backlash>,
    surface: Surface,
    surface_wave: Option<Sine>,
    /// Distance of the surface beyond its plane, into the specimen, mm.
    relief: Option<SpotMap>,
    curve: CurveAt,
    contact: ContactState,
    load_cell: LoadCellState,
    weight: Weight,
    friction: Option<(Friction, FrictionState)>,
    taxels: TaxelState,
    temperature: Option<Temperature>,
    /// What the only output is, in the scene of a monitor.
    monitored: Option<Monitored>,
    latency: [RandomStream; 3],
    faults: SceneFaults,
    witness: Witness,
}

/// Contact curve, and the relative change of its force from place to place (1 = twice as much).
#[derive(Clone)]
struct CurveAt {
    nominal: ContactLaw,
    more: Option<SpotMap>,
    edges: Option<Edges>,
}

impl Scene {
    /// Creates a scene at time 0, with the axes at rest at their power-on places. `seed` determines all noise, and
    /// the specimen unless the scene states a seed for it.
    pub fn new(spec: SceneSpec, setting: Surroundings, seed: u64) -> Self {
        let specimen = spec.specimen.unwrap_or(seed);
        let power_on = setting.power_on;
        let axes = Axis::ALL.map(|axis| Trajectory::at_rest(power_on.along(axis)));
        let surface = Surface::tilted(&setting.frame, spec.surface_tilt_mm, setting.half_extent_mm, specimen)
            .further(spec.surface_tilt);
        let relief = spec.relief.map(|relief| {
            let Relief { bumps_mm, bumps_wavelength_mm, roughness_mm } = relief;
            SpotMap::new(bumps_mm, bumps_wavelength_mm, roughness_mm, ["bumps", "roughness"], specimen)
        });
        let more = spec.stiffness.map(|stiffness| {
            let (smooth, white) = (stiffness.smooth_percent / 100.0, stiffness.white_percent / 100.0);
            SpotMap::new(smooth, STIFFNESS_WAVELENGTH_MM, white, ["stiffness", "stiffness of spots"], specimen)
        });
        let skin = Skin::new(&spec.skin, &setting.layout, setting.full_scale_n, specimen);
        let taxels = TaxelState::new(skin, &spec);
        let mut scene = Scene {
            seed,
            now_s: 0.0,
            profiles: axes.clone(),
            axes,
            servo: spec.stage.unwrap_or_default(),
            backlash: spec.stage.and_then(|stage| Backlash::new(stage.backlash_mm)),
            surface,
            surface_wave: spec.surface_wave,
            relief,
            curve: CurveAt { nominal: spec.contact, more, edges: spec.edges },
            contact: ContactState::new(
                spec.contact,
                spec.relaxation,
                spec.load_cell.and_then(|cell| cell.stiffness_n_mm),
            ),
            load_cell: LoadCellState::new(spec.load_cell, spec.temperature, setting.conversions_hz),
            weight: Weight::default(),
            friction: spec.friction.map(|friction| (friction, FrictionState::default())),
            taxels,
            temperature: spec.temperature,
            monitored: None,
            latency: SceneDevice::ALL.map(|device| stream(seed, 0, device.name())),
            setting: Surroundings { latencies: spec.latencies, ..setting },
            faults: SceneFaults::new(spec.faults),
            witness: Witness::default(),
        };
        scene.reseed(0, 0.0);
        scene.strike(f64::NEG_INFINITY, 0.0);
        scene
    }

    /// Makes it the scene of a monitor: it has one output, which is this reading, without faults and without delay.
    #[must_use]
    pub fn monitored(mut self, monitored: Monitored) -> Self {
        self.setting.latencies.array_s = (0.0, 0.0);
        Scene { monitored: Some(monitored), faults: SceneFaults::new(Vec::new()), ..self }
    }

    /// Starts the press of this number at `now_s`. From here on every random stream and the load cell's clock belong to that
    /// press, independent of the history.
    pub fn begin_press(&mut self, press: u64, now_s: f64) {
        self.advance(now_s);
        self.reseed(press + 1, now_s); // 0 is what happens before the first press
        self.contact.forget_peaks();
    }

    /// Position and speed of an axis at `now_s`, in the stage frame: (mm, mm/s).
    pub fn axis(&mut self, axis: Axis, now_s: f64) -> (f64, f64) {
        self.advance(now_s);
        let trajectory = &self.axes[axis.index()];
        (trajectory.position_mm(now_s), trajectory.speed_mm_s(now_s))
    }

    /// Motion of an axis as planned by the controller. The axis itself is later by the scene's servo lag.
    pub fn motion(&self, axis: Axis) -> &Trajectory {
        &self.profiles[axis.index()]
    }

    /// Returns the actual target of the stage for a requested target, mm: the nearest step, or the upper of two equally near
    /// steps.
    pub fn target_mm(&self, wanted_mm: f64) -> f64 {
        let quantum_mm = self.servo.quantum_mm;
        if quantum_mm > 0.0 { (wanted_mm / quantum_mm + HALF).floor() * quantum_mm } else { wanted_mm }
    }

    /// Starts a new motion of an axis at `now_s`. The trajectory must start at the position that the last
    /// [`motion`](Self::motion) has at that time.
    pub fn set_motion(&mut self, axis: Axis, trajectory: Trajectory, now_s: f64) {
        self.advance(now_s);
        let real = &mut self.axes[axis.index()];
        *real = real.followed_by(&trajectory, now_s, self.servo.lag_s);
        self.profiles[axis.index()] = trajectory;
        if axis != Axis::Z && !self.contact.touching() {
            self.contact.forget_load(); // relaxation history doesn't carry over to another spot
        }
    }

    /// Returns the load cell's reading at `now_s`, N: its last conversion that has arrived, pressing positive, with noise,
    /// without a zero subtracted.
    pub fn load_cell_n(&mut self, now_s: f64) -> f64 {
        self.advance(now_s);
        self.load_cell.read(now_s, &self.faults)
    }

    /// Returns the count that a load cell's converter reads at `now_s`, if `count_of` a force in N is its sound count.
    pub fn load_cell_count(&mut self, now_s: f64, count_of: impl Fn(f64) -> f64) -> f64 {
        self.advance(now_s);
        self.load_cell.count(now_s, &self.faults, count_of)
    }

    /// Returns the readings of a load cell with three axes at `now_s`, N: forces of the tip on the specimen along x and y of the
    /// specimen frame, and the force that [`load_cell_n`](Self::load_cell_n) reads.
    pub fn load_cell_axes_n(&mut self, now_s: f64) -> [f64; 3] {
        let force_n = self.load_cell_n(now_s);
        let hung_n = self.weight.force_n();
        let [x_n, y_n] = self.load_cell.side(self.surface.side_per_force(), hung_n, &self.faults, now_s);
        [x_n, y_n, force_n + self.load_cell.crosstalk_n(self.surface.side_per_force(), hung_n)]
    }

    /// Writes the outputs of all taxels at `now_s` to `outputs`, in units of the reading for 1 N straight above.
    ///
    /// # Panics
    /// If the length of `outputs` isn't the number of outputs.
    pub fn outputs(&mut self, now_s: f64, outputs: &mut [f64]) {
        if let Some(monitored) = &self.monitored {
            outputs.fill(monitored.reading(self.temperature_c(now_s)));
            return;
        }
        self.advance(now_s);
        let [x_n, y_n] = self.friction_n();
        self.taxels.outputs([x_n, y_n, self.contact.force_n()], self.place(now_s), now_s, outputs);
        if self.faults.any(FaultKind::ScaledOutputs, now_s) {
            let scale = self.faults.values(FaultKind::ScaledOutputs, now_s).product::<f64>();
            outputs.iter_mut().for_each(|output| *output *= scale);
        }
    }

    /// Number of outputs of the array: one for each channel of each taxel.
    pub fn taxels(&self) -> usize {
        if self.monitored.is_some() { 1 } else { self.setting.layout.len() }
    }

    /// Whether it is the scene of a monitor, whose output is a value with a unit.
    pub fn is_monitored(&self) -> bool {
        self.monitored.is_some()
    }

    /// Temperature at `now_s`, degrees Celsius; `None` if the scene doesn't name one.
    pub fn temperature_c(&self, now_s: f64) -> Option<f64> {
        self.temperature.map(|temperature| temperature.at_c(now_s))
    }

    /// Time that a device needs for its next request, received at `now_s`, s; `None` if it never acts on the request.
    pub(crate) fn latency_s(&mut self, device: SceneDevice, now_s: f64) -> Option<f64> {
        let silent = match device {
            SceneDevice::Stage => self.faults.any(FaultKind::StageLost, now_s),
            SceneDevice::LoadCell => self.faults.any(FaultKind::Stale, now_s),
            SceneDevice::Array => self.faults.silences_array(now_s),
        };
        if silent {
            return None;
        }
        let (least, most) = self.setting.latencies.of(device);
        let rng = &mut self.latency[device as usize];
        let mut latency_s = rng.random_range(least..=most);
        if device == SceneDevice::Stage {
            if let Some(spikes) = self.setting.latencies.stage_spikes
                && rng.random_bool(spikes.share)
            {
                latency_s += spikes.longer_s;
            }
            latency_s += self.faults.values(FaultKind::SlowStage, now_s).sum::<f64>() / 1000.0;
        }
        Some(latency_s)
    }

    /// The true contact force at `now_s`, N.
    pub fn true_force_n(&mut self, now_s: f64) -> f64 {
        self.advance(now_s);
        self.contact.force_n()
    }

    /// Starts to average the true force.
    pub fn open_window(&mut self, now_s: f64) {
        self.advance(now_s);
        self.witness.open_window();
    }

    /// Ends the average that [`open_window`](Self::open_window) started. If no time has passed, the average is the force of this
    /// moment.
    pub fn close_window(&mut self, now_s: f64) {
        self.advance(now_s);
        self.witness.close_window(self.contact.force_n());
    }

    /// Returns the true events since the last call (peaks: or since the press began): the window's mean and the largest values.
    pub fn take_truth(&mut self, now_s: f64) -> Truth {
        self.advance(now_s);
        let peaks = self.contact.peaks();
        self.contact.forget_peaks();
        self.witness.take(peaks)
    }

    /// Returns the events that would follow without further requests. They are the largest values from `now_s` until the axes
    /// rest, and the force at rest as `force_true_n`. The scene itself stays unchanged.
    pub fn run_out(&self, now_s: f64) -> Truth {
        let mut scene = self.clone();
        scene.take_truth(now_s);
        let rest_s = scene.axes.iter().map(Trajectory::end_s).fold(scene.now_s, f64::max);
        Truth { force_true_n: scene.true_force_n(rest_s), ..scene.take_truth(rest_s) }
    }

    /// Puts a known weight on the tip at `at_s`, which must not be past. The true force is within `u_n` of the nominal force, and
    /// follows from the seed. It acts along an axis of the specimen, z into it; a negative weight pulls.
    pub fn put_weight(&mut self, nominal_n: f64, u_n: f64, along: Axis, at_s: f64) {
        let force_n = weight::true_force_n(nominal_n, u_n, self.seed);
        self.weight.change(at_s, Axis::ALL.map(|axis| if axis == along { force_n } else { 0.0 }));
    }

    /// Removes the weight at `at_s`, which must not be past.
    pub fn take_weight(&mut self, at_s: f64) {
        self.weight.change(at_s, [0.0; 3]);
    }

    fn reseed(&mut self, press: u64, now_s: f64) {
        self.latency = SceneDevice::ALL.map(|device| stream(self.seed, press, device.name()));
        let noise = ["load cell noise", "load cell noise sideways"].map(|name| stream(self.seed, press, name));
        self.load_cell.begin(noise, now_s);
        self.load_cell.begin_glitches(self.seed, press);
        self.taxels.reseed(stream(self.seed, press, "taxel noise"));
    }

    fn place(&self, now_s: f64) -> Place {
        let [x, y, _] = self.axes.each_ref().map(|axis| axis.position_mm(now_s));
        self.setting.frame.place_from_stage(x, y)
    }
}

#[cfg(test)]
mod tests;
