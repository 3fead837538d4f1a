//! What a sensor does over time: creep, noise and wear on the page of a run, and many presses that are interrupted.

use palpate_data::dataset::{Recorded, cycled, followed};
use palpate_solver::over_time::{relaxation, wear};
use palpate_testing::{Live, TestFolder, campaign, exchanged, shipped_text};
use std::collections::BTreeSet;

/// Presses at one place: quick and full.
const CYCLES: (usize, usize) = (120, 9_984);

/// Kills of a run with many presses.
const KILLS: usize = 10;

/// Wear of the scene below in all presses of a long run, and in each press of a short one. More than a quarter ends the run, because the load
/// cell could be the cause.
const WEAR: f64 = -0.15;
const WEAR_A_PRESS: f64 = -1e-4;

/// Change of the gain by the temperature of the scene, 1/h.
const DRIFT_PER_H: f64 = 0.005;

fn rig(scene: &str) -> String {
    shipped_text("rigs/sim.toml").replace("[scene] ", &format!("[scene]\n{scene}\n#"))
}

fn cycles(presses: usize, every: usize) -> String {
    format!(
        "name = \"r\"\nrig = \"rig.toml\"\nchecks = \"none\"\n[[step]]\nphase = \"cycles\"\nlist = {{ places_mm = [[0, 0]] }}\n\
         force_n = 1.0\ncycles = {{ presses = {presses}, reference_every = {every}, reference_mm = [[4.5, 4.5]] }}\n"
    )
}

#[test]
fn page_has_a_figure_and_a_table_for_each_phase() {
    let recipe = shipped_text("recipes/over-time.toml").replace("120.0", "20.0").replace("1000", "60");
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    let check = bench.palpate_ends(0, "check r.toml").out;
    assert!(check.contains("shows time constants from 0.01 s to 20 s"), "{check}");
    bench.palpate_ends(0, "run r.toml --out run");
    bench.palpate_ends(0, "report run --figures figures");
    let page = bench.read("run/report.html");
    for title in ["Creep under load", "Ramps", "Waves", "Noise and drift without load", "Wear by many presses"] {
        assert!(page.contains(title), "{title}");
    }
    for figure in ["creep-1", "creep-3", "ramps-4", "wave-5", "allan-0", "cycles-2-0"] {
        assert!(bench.has(&format!("figures/{figure}.csv")), "{figure}");
    }
}

#[test]
fn creep_of_the_taxels_is_found_in_what_was_followed() {
    let scene = "taxel_creep = [{ share = 0.2, time_s = 4.0 }]\nelastomer = { depth_mm = 5.0 }\n\
                 contact = { linear_n_mm = 1.1, toe_mm = 0.01 }\nload_cell = { noise_n = 0.003 }\n[unused]";
    let rig = shipped_text("rigs/sim.toml");
    let rig = format!("{}[scene]\n{}", &rig[..rig.find("[scene]").unwrap()], scene.replace("\n[unused]", ""));
    let recipe = "name = \"r\"\nrig = \"rig.toml\"\nchecks = \"none\"\n[record]\nseries = \"window\"\n[[step]]\nphase = \"creep\"\n\
                  units = [5]\nforce_n = 1.0\nfollow_s = 40.0\n";
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", recipe)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let all = followed(&Recorded::read(&bench.path("run")).unwrap()).unwrap();
    let [only] = &all[..] else { panic!("{} were followed", all.len()) };
    assert_eq!((only.output, only.press), (5, 0));
    let found = relaxation(&only.values[0], &only.values[1]).unwrap();
    assert!(found.terms.len() == 1 && (found.terms[0].time_s - 4.0).abs() < 0.05, "{found:?}");
    let force = relaxation(&only.force_n[0], &only.force_n[1]).unwrap();
    assert!(force.terms.is_empty(), "a spring doesn't relax: {force:?}");
}

#[test]
fn wear_is_separated_from_the_drift_of_the_rig_and_every_press_counts_once_after_kills() {
    let presses = campaign::size(CYCLES.0, CYCLES.1);
    let (every, references) = (presses / 24, 25);
    let worn = (WEAR / presses as f64).max(WEAR_A_PRESS);
    let scene = format!(
        "wear = {{ gain_per_press = {worn}, radius_mm = 1.0 }}\n\
         temperature = {{ mean_c = 23.0, drift_c_h = 1.0, taxel_gain_per_c = {DRIFT_PER_H} }}"
    );
    let bench = TestFolder::with([("rig.toml", rig(&scene).as_str()), ("r.toml", &cycles(presses, every))]);
    bench.palpate_ends(0, "run r.toml --out whole");
    let recorded = Recorded::read(&bench.path("whole")).unwrap();
    let all = cycled(&recorded);
    assert_eq!(all.len(), 1);
    let found = wear(&all[0].points).unwrap();
    let [least, most] = found.wear_per_cycle.interval;
    println!("wear {:.2e} ({least:.2e} to {most:.2e}), drift {:?}", found.wear_per_cycle.value, found.drift_per_h);
    assert!(found.is_separate && least < worn && worn < most, "{found:?}");
    let mut words = "run r.toml --out run --json".to_owned();
    for kill in 0..KILLS {
        let mut live = Live::start(bench.command(&words));
        let mut lines = (presses + references) / (KILLS + 1);
        while lines > 0 && live.line().is_some() {
            lines -= 1;
        }
        live.kill();
        assert!(bench.has("run"), "kill {kill}");
        words = "resume run --json".to_owned();
    }
    bench.palpate_ends(0, "resume run");
    bench.palpate_ends(0, "verify run");
    let recorded = Recorded::read(&bench.path("run")).unwrap();
    let numbers: BTreeSet<u64> = recorded.contacts.iter().map(|contact| contact.press).collect();
    assert_eq!((numbers.len(), recorded.contacts.len()), (presses + references, presses + references));
    assert_eq!(cycled(&recorded)[0].points.iter().filter(|point| !point.is_reference).count(), presses);
}

#[test]
fn staircase_is_followed_after_its_last_level() {
    let recipe = "name = \"r\"\nrig = \"sim\"\nchecks = \"none\"\n[record]\nseries = \"window\"\n[[step]]\nphase = \"creep\"\n\
                  units = [5]\nstaircase = { to_n = 0.6, step_n = 0.2, repeats = 1 }\nfollow_s = 7.0\n";
    let bench = TestFolder::with([("r.toml", recipe)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let recorded = Recorded::read(&bench.path("run")).unwrap();
    let [contact] = &recorded.contacts[..] else { panic!("{} contacts", recorded.contacts.len()) };
    let last_s = contact.levels.last().and_then(|last| last.t_s).unwrap();
    let [time] = contact.followed[..] else { panic!("{:?}", contact.followed) };
    assert!(contact.levels.len() == 7 && time.from_s > last_s && time.to_s - time.from_s > 6.9, "{time:?}, {last_s}");
}

#[test]
fn readings_of_a_monitor_are_among_the_others_once_each() {
    let monitor = "[[monitor]]\nname = \"temperature_c\"\ndriver = { process = [\"thermometer\"] }\nlink = \"sim\"\nevery_s = 6.0\n";
    let scene = format!("{monitor}\n[scene]\ntemperature = {{ mean_c = 23.0, drift_c_h = 60.0 }}");
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "[scene]", &scene);
    let recipe = "name = \"r\"\nrig = \"rig.toml\"\nchecks = \"none\"\n[record]\nseries = \"window\"\n[[step]]\nphase = \"test\"\n\
                  units = \"all\"\nforce_n = 0.5\n";
    let bench = TestFolder::with([("r.toml", recipe), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run r.toml --out run");
    bench.palpate_ends(0, "export run --format csv --out exported");
    let column = |name: &str| bench.column("exported/series.csv", name);
    let rows = column("t_s").into_iter().zip(column("temperature_c")).filter(|(_, value)| !value.is_empty());
    let found: Vec<(f64, f64)> = rows.map(|(t_s, value)| (t_s.parse().unwrap(), value.parse().unwrap())).collect();
    let monitors = bench.column("run/monitors.csv", "t_s");
    let expected: BTreeSet<String> = monitors.iter().cloned().collect();
    assert!(expected.len() < monitors.len(), "several presses have one reading");
    assert_eq!(found.len(), expected.len());
    for (t_s, value) in found {
        assert!((value - 23.0 - t_s / 60.0).abs() < 1e-4, "{value} at {t_s} s");
    }
}

#[test]
fn every_cycle_counts_once_although_the_array_drops_out() {
    let presses = 90;
    let rig = format!("{}\n[[scene.fault]]\nkind = \"array-lost\"\nfrom_s = 90.0\n", shipped_text("rigs/sim.toml"));
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", &cycles(presses, 30))]);
    let mut drop_outs = 0;
    let mut ended = bench.palpate("run r.toml --out run");
    while ended.code == Some(3) && drop_outs < 10 {
        drop_outs += 1;
        ended = bench.palpate("resume run");
    }
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!((2..10).contains(&drop_outs), "{drop_outs}");
    let recorded = Recorded::read(&bench.path("run")).unwrap();
    let numbers: Vec<u64> = recorded.contacts.iter().map(|contact| contact.press).collect();
    assert_eq!(numbers, (0..presses as u64 + 4).collect::<Vec<_>>());
    assert_eq!(cycled(&recorded)[0].points.iter().filter(|point| !point.is_reference).count(), presses);
}

#[test]
fn a_published_protocol_over_time_runs_whole() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "init ts --from protocol:ts-comparison");
    bench.palpate_ends(0, "run ts/recipe.toml --rig ts/rig.toml --simulate --out run");
    bench.palpate_ends(0, "report run --figures figures");
    assert!(bench.has("figures/wave-0.csv") && bench.has("figures/ramps-1.csv"));
    bench.palpate_ends(0, "verify run");
}

#[test]
fn force_is_restored_where_the_recipe_holds_it() {
    let relaxation = "[{ share = 0.05, time_s = 0.3 }, { share = 0.05, time_s = 5.0 }]";
    let rig = exchanged(&shipped_text("rigs/sim.toml"), relaxation, "[{ share = 0.12, time_s = 6.0 }]");
    let step = |phase: &str| format!("[[step]]\nphase = {phase}\nunits = [5]\n");
    let held = "\"creep\"\nforce_n = 1.0\nfollow_s = 30.0";
    let wave = "\"wave\"\nwave = { force_n = [0.4, 1.0, 0.6, 0.0, 0.8], for_s = [6.0, 6.0, 6.0, 3.0, 6.0] }";
    let steps = [held.to_owned(), format!("{held}\nholds = \"force\""), wave.to_owned()].map(|phase| step(&phase));
    let recipe = format!(
        "name = \"r\"\nrig = \"rig.toml\"\nchecks = \"none\"\n[record]\nseries = \"window\"\n{}",
        steps.concat()
    );
    let bench = TestFolder::with([("r.toml", recipe.as_str()), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run r.toml --out run");
    let all = followed(&Recorded::read(&bench.path("run")).unwrap()).unwrap();
    let mean = |index: usize, from_s: f64| {
        let [t_s, force_n] = &all[index].force_n;
        let forces: Vec<f64> =
            t_s.iter().zip(force_n).filter(|(t_s, _)| (from_s..from_s + 0.9).contains(*t_s)).map(|(_, n)| *n).collect();
        forces.iter().sum::<f64>() / forces.len() as f64
    };
    let [relaxed_n, restored_n] = [0, 1].map(|index| mean(index, 28.0));
    assert!(relaxed_n < 0.95, "z rests: {relaxed_n} N");
    assert!((0.97..=1.0).contains(&restored_n), "the force stays: {restored_n} N");
    let most_n = all[1].force_n[1].iter().copied().fold(0.0, f64::max);
    assert!(most_n < 1.02, "{most_n} N of 1 N, with noise");
    assert!(mean(2, 4.5) > 0.38 && all[2].force_n[0].last().is_some_and(|span_s| (27.0..60.0).contains(span_s)));
    let forces_n: Vec<f64> =
        bench.column("run/presses.csv", "force_n").iter().map(|cell| cell.parse().unwrap()).collect();
    for (force_n, set_n) in forces_n.iter().skip(2).zip([0.4, 1.0, 0.6, 0.0, 0.8]) {
        assert!((force_n - set_n).abs() < 0.03, "{force_n} of {set_n} N");
    }
}

#[test]
fn phases_over_time_are_refused_where_they_are_incomplete() {
    let recipe = |step: &str, record: &str| {
        format!("name = \"r\"\nrig = \"sim\"\n{record}[[step]]\nlist = {{ places_mm = [[0, 0]] }}\n{step}\n")
    };
    let window = "[record]\nseries = \"window\"\n";
    let cycles = "cycles = { presses = 10, reference_mm = [[4, 4]] }";
    for (step, record, expected) in [
        ("phase = \"creep\"\nforce_n = 1.0", window, "the phase \"creep\" needs `follow_s`"),
        (
            "phase = \"creep\"\nforce_n = 1.0\nfollow_s = 9.0",
            "",
            "this step follows a level over time, but no readings are kept",
        ),
        ("phase = \"rest\"\nforce_n = 1.0\nfollow_s = 9.0", window, "a rest has no force and no depth"),
        ("phase = \"test\"\nforce_n = 1.0\nfollow_s = 9.0", window, "`follow_s` isn't used in the phase \"test\""),
        ("phase = \"wave\"\nforce_n = 1.0", window, "the phase \"wave\" needs `wave`"),
        (
            "phase = \"wave\"\nwave = { force_n = [0.2, 0.4], for_s = [1, 2, 3] }",
            window,
            "`for_s` has 3 times for 2 forces",
        ),
        ("phase = \"wave\"\nwave = { force_n = [0.0], for_s = 1 }", window, "has no force above 0"),
        (
            "phase = \"wave\"\nwave = { force_n = [0.2, 9], for_s = 1 }",
            window,
            "presses with 9 N, over the specimen's limit",
        ),
        (
            "phase = \"ramp\"\nforce_n = 1.0\nramps_mm_s = 1.0\nholds = \"force\"",
            window,
            "`holds` isn't used in the phase \"ramp\"",
        ),
        ("phase = \"cycles\"\nforce_n = 1.0", "", "the phase \"cycles\" needs `cycles`"),
        (&format!("phase = \"test\"\nforce_n = 1.0\n{cycles}"), "", "`cycles` isn't used in the phase \"test\""),
        (&format!("phase = \"cycles\"\n{cycles}"), "", "`cycles` needs one force"),
        (
            &format!("phase = \"cycles\"\nforce_n = 1.0\n{}", cycles.replace("[4, 4]", "[40, 4]")),
            "",
            "outside the stage's travel",
        ),
    ] {
        let bench = TestFolder::with([("r.toml", recipe(step, record).as_str())]);
        let refused = bench.palpate_ends(2, "check r.toml").running();
        assert!(refused.contains(expected), "{step}: {refused}");
    }
}
