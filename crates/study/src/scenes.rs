//! Scenes for the loop: the nominal bench with one change at a time.

use palpate_core::quantity::Limits;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{ContactLaw, LoadCellScene, RelaxationBranch, Relief, Servo, Spikes, Stiffness};

/// One change to a bench. The limits are those that a careful user would set, unless the scene is about a wrong limit.
#[derive(Clone, Copy, Debug)]
pub struct BenchChange {
    /// Name in tables and figures.
    pub name: &'static str,
    /// Requested force, N.
    pub force_n: f64,
    change: fn(&mut RigSpec),
}

/// Stiffness of a spring in series with bare steel, N/mm. The second constant is the stiffness of the steel, N/mm.
const SPRING_N_MM: f64 = 20.0;
const STEEL_N_MM: f64 = 500.0;
/// Stiffness of a hard specimen, N/mm.
const HARD_N_MM: f64 = 20.0;
/// Number of time constants of a low-pass that count as its lag.
const TIME_CONSTANTS: f64 = 2.5;

/// The unchanged benches.
pub const NOMINAL: BenchChange = change("nominal", 1.0, |_| {});

/// All scenes of the study.
pub(crate) const SCENES: [BenchChange; 13] = [
    NOMINAL,
    change("soft, 0.4 N/mm", 0.3, |spec| {
        spec.scene.contact = line(0.4, spec.scene.contact.toe_mm);
        spec.limits = Limits { force_n: 0.6, stiffness_n_mm: 0.5, ..spec.limits };
    }),
    change("hard, 20 N/mm", 1.0, |spec| {
        spec.scene.contact = line(HARD_N_MM, spec.scene.contact.toe_mm);
        spec.limits.stiffness_n_mm = 24.0;
    }),
    change("steel, 500 N/mm", 1.0, |spec| {
        steel(spec, STEEL_N_MM);
        spec.limits.stiffness_n_mm = 550.0;
    }),
    // two springs in series are one: 1 / (1/500 + 1/20) = 19.2 N/mm; no contact is stiffer than the spring
    change("steel behind 20 N/mm", 1.0, |spec| {
        steel(spec, 1.0 / (1.0 / STEEL_N_MM + 1.0 / SPRING_N_MM));
        spec.scene.stiffness = None;
        spec.limits.stiffness_n_mm = SPRING_N_MM;
    }),
    change("stiffness 3x as said", 1.0, |spec| {
        let ContactLaw { linear_n_mm, quadratic_n_mm2, .. } = &mut spec.scene.contact;
        *linear_n_mm *= 3.0;
        *quadratic_n_mm2 *= 3.0;
    }),
    change("viscous", 1.0, |spec| {
        let branch = |(share, time_s)| RelaxationBranch { share, time_s };
        spec.scene.relaxation = [(0.15, 0.3), (0.15, 5.0), (0.10, 30.0)].map(branch).to_vec();
        spec.limits.stiffness_n_mm = 2.5;
    }),
    change("noise 10 mN", 1.0, |spec| cell(spec).noise_n = 0.010),
    change("noise 30 mN", 1.0, |spec| cell(spec).noise_n = 0.030),
    change("50 Hz bus", 1.0, |spec| {
        let (transport_s, low_pass_hz) = (0.020, 20.0);
        *cell(spec) = LoadCellScene { transport_s, low_pass_hz: Some(low_pass_hz), ..*cell(spec) };
        spec.load_cell.conversions_hz = 50.0;
        spec.load_cell.lag_s = transport_s + TIME_CONSTANTS / (std::f64::consts::TAU * low_pass_hz);
    }),
    change("2 % spikes of 200 ms", 1.0, |spec| {
        spec.scene.latencies.stage_spikes = Some(Spikes { share: 0.02, longer_s: 0.2 })
    }),
    change("relief 30 um, k +-15 %", 1.0, |spec| {
        // short waves, because long ones are a slope that any map learns
        spec.scene.relief = Some(Relief { bumps_mm: 0.030, bumps_wavelength_mm: (1.0, 3.0), roughness_mm: 0.001 });
        spec.scene.stiffness = Some(Stiffness { smooth_percent: 15.0, white_percent: 0.5 });
    }),
    change("target quantum 1 um", 1.0, |spec| {
        spec.scene.stage = Some(Servo { quantum_mm: 0.001, ..spec.scene.stage.unwrap_or_default() });
    }),
];

const fn change(name: &'static str, force_n: f64, change: fn(&mut RigSpec)) -> BenchChange {
    BenchChange { name, force_n, change }
}

impl BenchChange {
    /// Returns a bench with the scene's change.
    #[must_use]
    pub fn on(&self, mut spec: RigSpec) -> RigSpec {
        (self.change)(&mut spec);
        spec
    }
}

/// Contact law of a specimen that doesn't stiffen with depth.
pub(super) fn line(linear_n_mm: f64, toe_mm: f64) -> ContactLaw {
    ContactLaw { linear_n_mm, quadratic_n_mm2: 0.0, toe_mm }
}

/// Makes the specimen bare metal: it carries force at once and doesn't relax.
fn steel(spec: &mut RigSpec, linear_n_mm: f64) {
    spec.scene.contact = line(linear_n_mm, 0.0);
    spec.scene.relaxation.clear();
}

fn cell(spec: &mut RigSpec) -> &mut LoadCellScene {
    spec.scene.load_cell.get_or_insert_default()
}

#[cfg(test)]
mod tests {
    use super::super::StudyBench;
    use super::*;

    /// The largest stiffness up to the largest force, relaxation and the stiffest place included, N/mm.
    fn largest_n_mm(spec: &RigSpec) -> f64 {
        let scene = &spec.scene;
        let shares: f64 = scene.relaxation.iter().map(|branch| branch.share).sum();
        let uneven = scene.stiffness.map_or(0.0, |uneven| uneven.smooth_percent + 2.0 * uneven.white_percent) / 100.0;
        scene.contact.stiffness_n_mm(1.0_f64.min(1.0 / scene.contact.linear_n_mm)) * (1.0 + shares) * (1.0 + uneven)
    }

    #[test]
    fn declared_stiffness_is_true_except_in_scenes_that_test_it() {
        for scene in SCENES {
            let spec = scene.on(StudyBench::XpsLike.spec().unwrap());
            let (largest, declared) = (largest_n_mm(&spec), spec.limits.stiffness_n_mm);
            let lies = scene.name.starts_with("stiffness 3x");
            assert_eq!(largest > declared, lies, "{}: {largest} of {declared} N/mm", scene.name);
            assert!(lies || declared < 1.6 * largest, "{}: {declared} for {largest} N/mm", scene.name);
        }
    }
}
