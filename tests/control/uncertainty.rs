//! The stated uncertainty of a force is true, over many load cells whose errors follow their certificates.
//!
//! `PALPATE_TESTS=full` tries 200 rigs of each kind.

use palpate_core::quantity::{COVERAGE, LoadCellCertificate, StatedError, stream};
use palpate_run::run::Ending;
use palpate_testing::campaign;
use palpate_testing::executions::{bench, executed, in_parallel, must_be_none, plan};
use rand::distr::{Distribution, Uniform};
use rand_distr::StandardNormal;

/// Rigs of each kind of certificate: quick and full.
const RIGS: (usize, usize) = (10, 200);

/// Expanded uncertainty of the cells' gains, percent, k = 2; and a class: limits of error as a fraction of full scale, percent and N.
const U_PERCENT: f64 = 1.0;
const CLASS_PERCENT: f64 = 0.5;
const FULL_SCALE_N: f64 = 2.0;

/// The set forces, N; the limit is above them.
const FORCES_N: [f64; 4] = [0.1, 0.5, 1.0, 2.0];
const LIMIT_N: f64 = 2.5;

#[test]
fn twice_the_stated_uncertainty_covers_the_error_as_often_as_it_says() {
    let rigs = campaign::size(RIGS.0, RIGS.1) as u64;
    let places: Vec<String> = FORCES_N
        .iter()
        .map(|n| format!("[[step]]\nphase = \"test\"\nlist = {{ places_mm = [[{n}, 0.5]] }}\nforce_n = {n}\n"))
        .collect();
    let recipe = format!("name = \"known\"\n{}", places.concat());
    let mut broken = Vec::new();
    for by_class in [false, true] {
        let jobs: Vec<u64> = (0..rigs).collect();
        let errors = in_parallel(&jobs, |&nth| {
            let mut spec = bench("bench-fast");
            spec.limits.force_n = LIMIT_N;
            let mut rng = stream(nth, u64::from(by_class), "gains");
            let cell = spec.scene.load_cell.as_mut().expect("a load cell");
            let stated = if by_class {
                // the largest error that a class allows, at full scale
                let off: f64 = Uniform::new(-1.0, 1.0).expect("a range").sample(&mut rng);
                cell.gain = 1.0 + off * CLASS_PERCENT / 100.0;
                StatedError::Class { class_percent: CLASS_PERCENT, full_scale_n: FULL_SCALE_N }
            } else {
                let off: f64 = StandardNormal.sample(&mut rng);
                cell.gain = 1.0 + off * U_PERCENT / COVERAGE / 100.0;
                StatedError::Relative { u_percent: U_PERCENT, k: COVERAGE }
            };
            spec.load_cell.certificate =
                Some(LoadCellCertificate { number: "1".into(), date: "2026-05-04".into(), stated, temperature: None });
            let executed = executed(&spec, &plan(&spec, &recipe, nth + 1));
            let Ending { halt: None, unparked: None, .. } = executed.ending else { panic!("{:?}", executed.ending) };
            let of = |contact: &palpate_data::dataset::RecordedContact| {
                let (press, truth) = (&contact.levels[0], &contact.truth[0]);
                let error_n = press.force_n.expect("a force") - truth.force_true_n;
                error_n / press.u_force_n.expect("a certificate makes an uncertainty")
            };
            executed.ledger.contacts().map(of).collect::<Vec<f64>>()
        });
        for (n, force_n) in FORCES_N.iter().enumerate() {
            let covered = errors.iter().filter(|of_rig| of_rig[n].abs() <= COVERAGE).count();
            let share = covered as f64 / rigs as f64;
            // random deviation from 95.4 % in so many rigs, 3 sd
            let chance = 3.0 * (0.954f64 * 0.046 / rigs as f64).sqrt();
            let output = format!(
                "{} rigs, {}, {force_n} N: k = 2 covers {:.1} %",
                rigs,
                if by_class { "a class of 0.5 % of 2 N" } else { "U of 1 % of the force" },
                100.0 * share
            );
            println!("{output}");
            let (least, most) = if by_class { (0.95, 1.0) } else { (0.94, 0.97) };
            if share < least - chance || share > most + chance {
                broken.push(output);
            }
        }
    }
    must_be_none(&broken);
}
