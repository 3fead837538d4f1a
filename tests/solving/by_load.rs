//! Presses without forces: a second method answers readings with the load of the calibration.

use super::choice::{ChoicePress, FAMILIES, Family};
use palpate_core::parallel::in_parallel;
use palpate_solver::{BEST, Calibration, CalibrationPoint, Model, Session, Setting, Solver as _, Workspace};
use palpate_testing::{TestFolder, campaign};
use std::fs::File;
use std::sync::Arc;

/// Families that are calibrated with one load.
fn families() -> impl Iterator<Item = Family> {
    FAMILIES.into_iter().filter(|family| family.force_n.0 == family.force_n.1)
}

fn fitted(solver: &str, presses: &[ChoicePress], has_forces: bool) -> Model {
    let points: Vec<CalibrationPoint<'_>> = presses
        .iter()
        .map(|press| CalibrationPoint { place: press.place, force_n: press.force_n, outputs: &press.outputs })
        .collect();
    let calibration = if has_forces { Calibration::new(&points) } else { Calibration::without_forces(&points) };
    Model::fit(solver, calibration.expect("a calibration"), &Setting::default()).expect("a fit")
}

/// Mean location error, mm, and the fraction of readings that the second method answered.
fn solved(model: &Arc<Model>, presses: &[ChoicePress]) -> (f64, f64) {
    let mut session = Session::new(model.clone());
    let (mut off_mm, mut at_calibrated_load) = (0.0, 0.0);
    for press in presses {
        let solution = session.solve(&press.outputs).expect("an answer");
        off_mm += solution.place.distance_mm(press.place);
        at_calibrated_load += f64::from(u8::from(solution.is_calibrated_load));
    }
    (off_mm / presses.len() as f64, at_calibrated_load / presses.len() as f64)
}

#[test]
fn the_amplitude_is_used_where_contacts_have_the_load_of_the_calibration() {
    let seeds = campaign::size(1, 10) as u64;
    let sets: Vec<(Family, u64)> =
        families().take(campaign::size(1, 3)).flat_map(|family| (0..seeds).map(move |seed| (family, seed))).collect();
    let ratios = in_parallel(&sets, |(family, seed)| {
        let same = family.set_with(*seed, (1.0, 1.0));
        let others = family.set_with(*seed, (0.3, 3.0));
        let both = Arc::new(fitted(BEST, &same.calibration, false));
        let second = both.fitted().at_calibrated_load();
        let any = Arc::new(fitted(both.fitted().name(), &same.calibration, false));
        let [(same_mm, answered), (others_mm, wrongly)] = [&same, &others].map(|set| solved(&both, &set.test));
        let [(same_any_mm, _), (others_any_mm, _)] = [&same, &others].map(|set| solved(&any, &set.test));
        println!(
            "{} {seed}, second {second:?}: {:.3} of the error at the calibrated load ({answered:.2} answered), {:.3} at \
             others ({wrongly:.3})",
            family.name,
            same_mm / same_any_mm,
            others_mm / others_any_mm
        );
        assert_eq!(second.is_some(), answered > 0.0);
        (same_mm / same_any_mm, others_mm / others_any_mm)
    });
    let count = ratios.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| ratios.iter().map(of).sum::<f64>() / count;
    let (same, others) = (mean(|ratio| ratio.0), mean(|ratio| ratio.1));
    println!("mean: {same:.3} at the calibrated load, {others:.3} at others");
    assert!(same <= 0.9, "the amplitude shows the place: {same}");
    assert!(others <= 1.02 && ratios.iter().all(|ratio| ratio.1 <= 1.1), "{ratios:?}");
}

#[test]
fn a_second_method_needs_one_unknown_load() {
    let set = FAMILIES[0].set_with(0, (1.0, 1.0));
    let second = |presses: &[ChoicePress], has_forces| fitted(BEST, presses, has_forces).fitted().at_calibrated_load();
    assert!(second(&set.calibration, false).is_some());
    assert_eq!(second(&set.calibration, true), None, "forces are known");
    // each place pressed with two loads
    let few = set.calibration.into_iter().step_by(2).flat_map(|press| {
        let outputs = press.outputs.iter().map(|output| 0.5 * output).collect();
        [ChoicePress { outputs, ..press }, press]
    });
    let both: Vec<ChoicePress> = few.collect();
    assert_eq!(second(&both, false), None, "two loads");
}

#[test]
fn half_widths_are_wider_where_a_contact_has_another_load() {
    let set = FAMILIES[0].set_with(0, (1.0, 1.0));
    let [unknown, known] = [false, true].map(|has_forces| fitted("surrogate", &set.calibration, has_forces));
    let ratio = |share: f64, press: &ChoicePress| {
        let outputs: Vec<f64> = press.outputs.iter().map(|output| share * output).collect();
        let half_mm = |model: &Model| {
            let solution = model.fitted().solve(&outputs, &mut Workspace::default()).expect("an answer");
            solution.half_widths.expect("half-widths").half68_mm
        };
        half_mm(&unknown) / half_mm(&known)
    };
    let median = |share: f64| {
        let mut ratios: Vec<f64> = set.test.iter().take(50).map(|press| ratio(share, press)).collect();
        ratios.sort_by(f64::total_cmp);
        ratios[25]
    };
    let (same, half_more) = (median(1.0), median(1.5));
    // 1 + ln 1.5 is 1.41, and the map of unknown forces fits a little worse
    assert!((1.3..1.7).contains(&(half_more / same)), "{same} {half_more}");
}

#[test]
fn solve_shows_which_method_answered() {
    let bench = TestFolder::new();
    FAMILIES[0].set_with(0, (1.0, 1.0)).save(&bench.path("."));
    for table in ["calibration", "test"] {
        let text = bench.read(&format!("gains-0/{table}.csv"));
        let without_force = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            let first = if table == "test" { 3 } else { 0 };
            [&cells[first.min(2)..2], &cells[3..]].concat().join(",") + "\n"
        };
        bench.write(&format!("{table}.csv"), &text.lines().take(200).map(without_force).collect::<String>());
    }
    let printed = bench.palpate_ends(0, "fit calibration.csv --out s.palpate");
    assert!(printed.running().contains("readings with the load of the calibration are solved by"), "{}", printed.err);
    let loads = |readings: &str| -> Vec<String> {
        let input = File::open(bench.path(readings)).expect("readings");
        let output = bench.command("solve --model s.palpate --quiet").stdin(input).output().expect("an end");
        let out = String::from_utf8(output.stdout).expect("text");
        let mut lines = out.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let column = lines.next().expect("a header").iter().position(|name| name == "load").expect("a column load");
        lines.map(|cells| cells[column].clone()).collect()
    };
    let of_load = |loads: &[String], load: &str| loads.iter().filter(|found| *found == load).count();
    let all = loads("test.csv");
    assert!(of_load(&all, "calibrated") * 10 >= all.len() * 9, "{all:?}");
    // a lighter contact, and one that lacks an output
    let mut lines = bench.read("test.csv");
    let header = lines.lines().next().expect("a header").to_owned();
    let reading: Vec<f64> = lines.lines().nth(5).expect("a reading").split(',').map(|c| c.parse().unwrap()).collect();
    lines = [0.4, 1.0]
        .map(|share| {
            let cells = reading.iter().enumerate().map(|(unit, output)| match (unit, share) {
                (15, 1.0) => "nan".to_owned(),
                _ => (share * output).to_string(),
            });
            cells.collect::<Vec<_>>().join(",")
        })
        .join("\n");
    bench.write("two.csv", &format!("{header}\n{lines}\n"));
    assert_eq!(loads("two.csv"), ["any", "calibrated"]);
    let refused = bench.palpate_ends(2, "export --model s.palpate --format c --out s.h");
    assert!(
        refused.running().contains("for readings with the load of the calibration can't be exported as C"),
        "{}",
        refused.err
    );
}
