//! What the loop is tried on: the nominal bench with one thing changed at a time.

use crate::quantity::Limits;
use crate::rig::RigSpec;
use crate::scene::{ContactLaw, LoadCell, RelaxationBranch, Relief, Servo, Spikes, Stiffness};

/// One change to a bench. Unless the scene is about a wrong one, the limits are those that an honest user would set.
#[derive(Clone, Copy, Debug)]
pub struct BenchChange {
    /// As it stands in tables and figures.
    pub name: &'static str,
    /// The force that is asked for, N.
    pub force_n: f64,
    change: fn(&mut RigSpec),
}

/// A spring in series with bare steel, N/mm, and what the two make together.
const SPRING_N_MM: f64 = 20.0;
const STEEL_N_MM: f64 = 500.0;
/// How many time constants of a low-pass count as its lag.
const TIME_CONSTANTS: f64 = 2.5;

/// The benches as they are.
pub const NOMINAL: BenchChange = BenchChange { name: "nominal", force_n: 1.0, change: |_| {} };

/// All scenes of the study.
pub const SCENES: [BenchChange; 13] = [
    NOMINAL,
    BenchChange {
        name: "soft, 0.4 N/mm",
        force_n: 0.3,
        change: |spec| {
            spec.scene.contact = line(0.4, spec.scene.contact.toe_mm);
            spec.limits = Limits { force_n: 0.6, stiffness_n_mm: 0.5, ..spec.limits };
        },
    },
    BenchChange {
        name: "hard, 20 N/mm",
        force_n: 1.0,
        change: |spec| {
            spec.scene.contact = line(20.0, spec.scene.contact.toe_mm);
            spec.limits.stiffness_n_mm = 24.0;
        },
    },
    BenchChange {
        name: "steel, 500 N/mm",
        force_n: 1.0,
        change: |spec| {
            steel(spec, STEEL_N_MM);
            spec.limits.stiffness_n_mm = 550.0;
        },
    },
    BenchChange {
        // two springs in series are one: 1 / (1/500 + 1/20) = 19.2 N/mm; no contact is stiffer than the spring
        name: "steel behind 20 N/mm",
        force_n: 1.0,
        change: |spec| {
            steel(spec, 1.0 / (1.0 / STEEL_N_MM + 1.0 / SPRING_N_MM));
            spec.scene.stiffness = None;
            spec.limits.stiffness_n_mm = SPRING_N_MM;
        },
    },
    BenchChange {
        name: "stiffness 3x as said",
        force_n: 1.0,
        change: |spec| {
            let ContactLaw { linear_n_mm, quadratic_n_mm2, .. } = &mut spec.scene.contact;
            *linear_n_mm *= 3.0;
            *quadratic_n_mm2 *= 3.0;
        },
    },
    BenchChange {
        name: "viscous",
        force_n: 1.0,
        change: |spec| {
            let branch = |(share, time_s)| RelaxationBranch { share, time_s };
            spec.scene.relaxation = [(0.15, 0.3), (0.15, 5.0), (0.10, 30.0)].map(branch).to_vec();
            spec.limits.stiffness_n_mm = 2.5;
        },
    },
    BenchChange { name: "noise 10 mN", force_n: 1.0, change: |spec| cell(spec).noise_n = 0.010 },
    BenchChange { name: "noise 30 mN", force_n: 1.0, change: |spec| cell(spec).noise_n = 0.030 },
    BenchChange {
        name: "50 Hz bus",
        force_n: 1.0,
        change: |spec| {
            let (transport_s, low_pass_hz) = (0.020, 20.0);
            *cell(spec) = LoadCell { transport_s, low_pass_hz: Some(low_pass_hz), ..*cell(spec) };
            spec.load_cell.conversions_hz = 50.0;
            spec.load_cell.lag_s = transport_s + TIME_CONSTANTS / (std::f64::consts::TAU * low_pass_hz);
        },
    },
    BenchChange {
        name: "2 % spikes of 200 ms",
        force_n: 1.0,
        change: |spec| spec.scene.latencies.stage_spikes = Some(Spikes { share: 0.02, longer_s: 0.2 }),
    },
    BenchChange {
        name: "relief 30 um, k +-15 %",
        force_n: 1.0,
        change: |spec| {
            // short waves: long ones are a slope, which any map learns
            spec.scene.relief = Some(Relief { bumps_mm: 0.030, bumps_wavelength_mm: (1.0, 3.0), roughness_mm: 0.001 });
            spec.scene.stiffness = Some(Stiffness { smooth_percent: 15.0, white_percent: 0.5 });
        },
    },
    BenchChange {
        name: "target quantum 1 um",
        force_n: 1.0,
        change: |spec| {
            spec.scene.stage = Some(Servo { quantum_mm: 0.001, ..spec.scene.stage.unwrap_or_default() });
        },
    },
];

impl BenchChange {
    /// A bench with the scene's change.
    #[must_use]
    pub fn on(&self, mut spec: RigSpec) -> RigSpec {
        (self.change)(&mut spec);
        spec
    }
}

/// A specimen that doesn't stiffen with depth.
pub(super) fn line(linear_n_mm: f64, toe_mm: f64) -> ContactLaw {
    ContactLaw { linear_n_mm, quadratic_n_mm2: 0.0, toe_mm }
}

/// Bare metal: it bears at once and doesn't relax.
fn steel(spec: &mut RigSpec, linear_n_mm: f64) {
    spec.scene.contact = line(linear_n_mm, 0.0);
    spec.scene.relaxation.clear();
}

fn cell(spec: &mut RigSpec) -> &mut LoadCell {
    spec.scene.load_cell.get_or_insert_default()
}

#[cfg(test)]
mod tests {
    use super::super::Bench;
    use super::*;

    /// The largest stiffness up to the largest force, relaxation and the stiffest place included, N/mm.
    fn largest_n_mm(spec: &RigSpec) -> f64 {
        let scene = &spec.scene;
        let shares: f64 = scene.relaxation.iter().map(|branch| branch.share).sum();
        let uneven = scene.stiffness.map_or(0.0, |uneven| uneven.smooth_percent + 2.0 * uneven.white_percent) / 100.0;
        scene.contact.stiffness_n_mm(1.0_f64.min(1.0 / scene.contact.linear_n_mm)) * (1.0 + shares) * (1.0 + uneven)
    }

    #[test]
    fn the_declared_stiffness_is_honest_but_where_it_is_not_meant_to_be() {
        for scene in SCENES {
            let spec = scene.on(Bench::XpsLike.spec().unwrap());
            let (largest, declared) = (largest_n_mm(&spec), spec.limits.stiffness_n_mm);
            let lies = scene.name.starts_with("stiffness 3x");
            assert_eq!(largest > declared, lies, "{}: {largest} of {declared} N/mm", scene.name);
            assert!(lies || declared < 1.6 * largest, "{}: {declared} for {largest} N/mm", scene.name);
        }
    }
}
