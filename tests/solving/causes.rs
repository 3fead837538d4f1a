//! What a misfit means, on the paper's array: each true cause and the verdicts on it. See the table with
//! `PALPATE_TESTS=full cargo test --release --test solving causes:: -- --nocapture`.

use super::two_contacts::apart;
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_solver::causes::{Candidate, Causes, Explanation, MisfitCause, explain};
use palpate_solver::vector::{VectorMap, VectorWorkspace};
use palpate_testing::campaign;
use palpate_testing::vectors::{HALF_MM, VectorScene};
use rand::RngExt;
use std::f64::consts::TAU;

const CAUSES: [&str; 5] = ["one contact", "shear", "two contacts", "broken unit", "outside area"];
/// Positions of the verdicts without a true cause.
const EITHER: usize = CAUSES.len();
const WRONG_UNIT: usize = EITHER + 1;
/// Lead of the true cause over the others, without noise, from which the outputs show it: twice what another explanation may lack.
const SHOWN: f64 = 12.0;

/// Loads of a true cause, and the unit that is dead.
fn drawn(cause: usize, rng: &mut RandomStream) -> (Vec<(Place, [f64; 3])>, Option<usize>) {
    let [first, second] = apart(rng.random_range(3.0..=6.0), rng);
    let force_n = rng.random_range(0.2..=1.0);
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    let shear_n = force_n * rng.random_range(0.2..=0.5);
    let dead = rng.random_range(0..9);
    match cause {
        1 => (vec![(first, [shear_n * cos, shear_n * sin, force_n])], None),
        2 => ([first, second].map(|place| (place, [0.0, 0.0, force_n])).to_vec(), None),
        3 => (vec![(first, [0.0, 0.0, force_n])], Some(dead)),
        4 => {
            let side_mm = HALF_MM + rng.random_range(0.5..=1.5);
            let along = [side_mm.copysign(cos), first.y_mm];
            let place = if rng.random() { Place::new(along[0], along[1]) } else { Place::new(along[1], along[0]) };
            (vec![(place, [0.0, 0.0, force_n])], None)
        }
        _ => (vec![(first, [0.0, 0.0, force_n])], None),
    }
}

fn index(cause: MisfitCause, dead: Option<usize>) -> usize {
    match cause {
        MisfitCause::Shear => 1,
        MisfitCause::TwoContacts => 2,
        // another unit is a wrong name
        MisfitCause::BrokenUnit(unit) => {
            if dead.is_none_or(|dead| dead == unit) {
                3
            } else {
                WRONG_UNIT
            }
        }
        MisfitCause::Outside => 4,
    }
}

/// Lead of a cause over the others and over one contact.
fn lead(candidates: &[Candidate], cause: usize, dead: Option<usize>) -> f64 {
    let excess = |is_it: bool| {
        let all = candidates.iter().filter(|candidate| (index(candidate.cause, dead) == cause) == is_it);
        all.map(Candidate::excess).fold(if is_it { f64::NEG_INFINITY } else { 0.0 }, f64::max)
    };
    excess(true) - excess(false)
}

#[test]
fn each_cause_is_named_where_the_outputs_show_it() {
    let tests = campaign::size(20, 2000);
    let scenes = [
        ("T, three axes", VectorScene::t(3), 3),
        ("T, normal", VectorScene::t(1), 1),
        ("1 mV, normal", VectorScene::of_1_mv(1), 1),
        ("1 mV, three axes", VectorScene::of_1_mv(3), 3),
    ];
    for (name, mut scene, channels) in scenes.into_iter().take(campaign::size(1, 4)) {
        let layout = ArrayLayout::grid(3, 3, 4.5).with_channels(channels);
        let map =
            VectorMap::fit(&scene.calibration(if campaign::is_quick() { 9 } else { 25 }, true, 1)).expect("a map");
        let causes = Causes::new(map, &layout);
        let mut workspace = VectorWorkspace::default();
        println!(
            "{name}: named one contact, shear, two, broken, outside, either, wrong unit; shown, and of these right, either"
        );
        for (cause, text) in CAUSES.into_iter().enumerate() {
            let mut rng = stream(6, cause as u64, "causes");
            let (mut named, mut shown, mut right, mut either) = ([0.0; WRONG_UNIT + 1], 0.0, 0.0, 0.0);
            for _ in 0..tests {
                let (loads, dead) = drawn(cause, &mut rng);
                let silence = |outputs: &mut Vec<f64>| {
                    if let Some(unit) = dead {
                        outputs[unit * channels..(unit + 1) * channels].fill(0.0);
                    }
                };
                let (mut exact, mut outputs) = (scene.exact(&loads), scene.read(&loads, &mut rng));
                silence(&mut exact);
                silence(&mut outputs);
                let candidates = causes.candidates(&outputs, &mut workspace).expect("a contact");
                let verdict = match explain(&candidates) {
                    Explanation::OneContact => 0,
                    Explanation::Is(cause) => index(cause, dead),
                    Explanation::Either(..) => EITHER,
                };
                named[verdict] += 1.0 / tests as f64;
                let of_exact = causes.candidates(&exact, &mut workspace).expect("a contact");
                if cause > 0 && lead(&of_exact, cause, dead) > SHOWN {
                    shown += 1.0;
                    right += f64::from(u8::from(verdict == cause));
                    either += f64::from(u8::from(verdict == EITHER));
                }
            }
            let (right, either) = (right / f64::max(shown, 1.0), either / f64::max(shown, 1.0));
            let slack = if campaign::is_quick() { 0.1 } else { 0.0 };
            assert!(cause > 0 || named[0] >= 0.98 - slack, "{name}: one contact is flagged: {named:?}");
            assert!(shown < 20.0 || right >= 0.80 - slack, "{name}: {text} is named in {right}");
            println!("  {text:<13} {named:.3?} shown {:.3}: {right:.3} {either:.3}", shown / tests as f64);
        }
    }
}

/// Each cause may flag half of the accepted share, so that all together flag about the share.
#[test]
fn single_contacts_are_flagged_at_the_accepted_rate() {
    let (tests, layout) = (campaign::size(400, 4000), ArrayLayout::grid(3, 3, 4.5));
    let mut scene = VectorScene::t(1);
    let map = VectorMap::fit(&scene.calibration(9, false, 1)).expect("a map");
    let mut flagged = |share: f64| {
        let map = map.clone().with_false_alarms(share);
        let (causes, mut workspace) = (Causes::new(map.clone(), &layout), VectorWorkspace::default());
        let mut rng = stream(7, 0, "false alarms");
        let mut is_flagged = || {
            let outputs = scene.read(&drawn(0, &mut rng).0, &mut rng);
            let explained = explain(&causes.candidates(&outputs, &mut workspace).expect("a contact"));
            let is_misfit = map.solve(&outputs, &mut workspace).expect("a contact").misfit > 1.0;
            [explained != Explanation::OneContact, is_misfit]
        };
        let all: Vec<[bool; 2]> = (0..tests).map(|_| is_flagged()).collect();
        [0, 1].map(|by| all.iter().filter(|flagged| flagged[by]).count() as f64 / tests as f64)
    };
    for share in [0.05, 0.01].into_iter().take(campaign::size(1, 2)) {
        let found = flagged(share);
        println!("flagged by a cause, and by the misfit: {found:.4?} at {share}");
        assert!(found.iter().all(|found| (0.4 * share..2.0 * share).contains(found)), "{found:?} at {share}");
    }
}
