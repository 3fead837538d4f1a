//! Checks after a run: the first place is pressed again, the plan's presses don't change, and a changed load cell or sensor leaves the
//! verdict undecided.

use palpate_core::quantity::{Axis, WeightCheck};
use palpate_data::dataset::{Ledger, Memory, Record, RecordedCheck, RecordedContact, Status};
use palpate_data::recipe::{Checks, Phase, Plan};
use palpate_run::rig::RigSpec;
use palpate_run::run::{Ask, Cancel, Ending, KnownWeight, Listener, RunJob, execute, rehearse};
use palpate_testing::executions::{bench, plan, run_virtually};
use palpate_testing::interrupted::{change_the_world, cut_to_lines, lines_before_contacts};
use palpate_testing::{TestFolder, shipped_text};

/// Five presses: fewer than the rules within a run need for a comparison.
const TINY: &str = "name = \"tiny\"\nrig = \"sim\"\n[[step]]\nphase = \"calibration\"\n\
                    list = { places_mm = [[0, 0], [2, 0], [0, 2], [2, 2]] }\nforce_n = 1.0\n\
                    [[step]]\nphase = \"test\"\nlist = { places_mm = [[1, 1]] }\nforce_n = 1.0\n\
                    [accept]\nlocation_mean_mm = 100.0\n";
const TINY_PRESSES: u64 = 5;

/// 13 by 8 presses: a check comes after the hundredth.
const LONGER: &str = "name = \"longer\"\nrig = \"sim\"\nchecks = \"between\"\n[[step]]\nphase = \"calibration\"\n\
                      cells = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], columns = 13, rows = 8 }\nforce_n = 1.0\n\
                      strategy = \"velocity\"\n";
const BEFORE_CHECK: usize = 100;

/// A person who stops after so many presses.
struct Stopping<'a> {
    cancel: &'a Cancel,
    left: usize,
}

impl Listener for Stopping<'_> {
    fn recorded(&mut self, _: &RecordedContact) {
        self.left -= 1;
        if self.left == 0 {
            self.cancel.ask();
        }
    }
}

/// Executes a plan for so many more presses.
fn executed(spec: &RigSpec, plan: &Plan, memory: &mut Memory, presses: usize) -> Ending {
    let cancel = Cancel::default();
    run_virtually(async {
        let job = RunJob { plan, spec, ledger: memory as &mut dyn Ledger, cancel: &cancel, shown: &|_| {} };
        execute(job, &mut Stopping { cancel: &cancel, left: presses }).await
    })
}

fn checks(memory: &Memory) -> Vec<RecordedCheck> {
    let check = |record: &Record| match record {
        Record::Check(check) => Some(check.clone()),
        _ => None,
    };
    memory.records().iter().filter_map(check).collect()
}

/// The contacts and checks in their order: the number of a press; none for a check.
fn order(memory: &Memory) -> Vec<Option<u64>> {
    let number = |record: &Record| match record {
        Record::Check(_) => Some(None),
        record => record.contact().map(|contact| Some(contact.press)),
    };
    memory.records().iter().filter_map(number).collect()
}

fn whole(spec: &RigSpec, plan: &Plan) -> Memory {
    let mut memory = Memory::default();
    let ending = executed(spec, plan, &mut memory, usize::MAX);
    assert_eq!(ending.status(), Status::Complete, "{:?}", ending.text());
    memory
}

#[test]
fn a_run_ends_with_a_check_that_changes_no_press() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, TINY, 1);
    let (with, without) = (whole(&spec, &plan), whole(&spec, &Plan { checks: Checks::None, ..plan.clone() }));
    assert_eq!(with.contacts().collect::<Vec<_>>(), without.contacts().collect::<Vec<_>>());
    assert_eq!(checks(&without), []);
    let [check] = &checks(&with)[..] else { panic!("{:?}", checks(&with)) };
    assert!(!check.is_failed() && check.at_end && check.reference == 0, "{}", check.line());
    let row = &check.contact.levels[0];
    assert_eq!((row.press, row.phase, row.force_set_n), (0, Some(Phase::Check), Some(1.0)));
    assert!(check.cell < 0.05, "{check:?}");
    assert_eq!(rehearse(&plan, &spec).expect("it is simulated").checks.len(), 1);
}

#[test]
fn a_check_reaches_a_place_whose_surface_is_higher_than_that_of_the_last_press() {
    let mut spec = bench("bench-fast");
    spec.scene.surface_tilt_mm = 0.25;
    for seed in 1..=4 {
        let [check] = &checks(&whole(&spec, &plan(&spec, TINY, seed)))[..] else { panic!("{seed}: no check") };
        assert!(!check.is_failed(), "{seed}: {}", check.line());
    }
}

#[test]
fn weak_press_is_not_used_as_reference() {
    let spec = bench("bench-fast");
    let weak = "name = \"weak\"\n[[step]]\nphase = \"test\"\nlist = { places_mm = [[-2, 0]] }\nforce_n = 0.2\n";
    let plan = plan(&spec, &TINY.replacen("name = \"tiny\"\nrig = \"sim\"\n", weak, 1), 1);
    let made = checks(&whole(&spec, &plan));
    assert_eq!(made.iter().map(|check| check.reference).collect::<Vec<_>>(), [1]);
    assert_eq!(rehearse(&plan, &spec).expect("it is simulated").checks[0].place, plan.entries[1].place);
}

#[test]
fn check_comes_after_a_hundred_presses_also_in_an_interrupted_run() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, LONGER, 1);
    let memory = whole(&spec, &plan);
    let order_of_all = order(&memory);
    let places: Vec<usize> = (0..order_of_all.len()).filter(|&i| order_of_all[i].is_none()).collect();
    assert_eq!(places, [BEFORE_CHECK, plan.entries.len() + 1]);
    let made = checks(&memory);
    assert!(made.iter().all(|check| !check.is_failed() && check.reference == 0), "{made:?}");
    assert_eq!(made.iter().map(|check| (check.number, check.at_end)).collect::<Vec<_>>(), [(0, false), (1, true)]);
    assert_eq!(rehearse(&plan, &spec).expect("it is simulated").checks.len(), 2);

    let at_end = whole(&spec, &Plan { checks: Checks::End, ..plan.clone() });
    let first: Vec<&RecordedContact> = memory.contacts().take(BEFORE_CHECK).collect();
    assert_eq!(first, at_end.contacts().take(BEFORE_CHECK).collect::<Vec<_>>());

    // stopped when the check is due, and again when only the last one is missing
    let mut interrupted = Memory::default();
    for presses in [BEFORE_CHECK, plan.entries.len() - BEFORE_CHECK] {
        assert_eq!(executed(&spec, &plan, &mut interrupted, presses).status(), Status::Stopped);
    }
    assert_eq!(executed(&spec, &plan, &mut interrupted, usize::MAX).status(), Status::Complete);
    assert_eq!(order(&interrupted), order_of_all);
    let numbers =
        |check: &RecordedCheck| (check.number, check.reference, check.at_end, check.contact.levels[0].place());
    assert_eq!(
        checks(&interrupted).iter().map(numbers).collect::<Vec<_>>(),
        made.iter().map(numbers).collect::<Vec<_>>()
    );
}

#[test]
fn no_check_comes_inside_a_characterisation_or_a_rest() {
    let spec = bench("bench-fast");
    let recipe = "name = \"r\"\nrig = \"sim\"\nchecks = \"between\"\n[[step]]\nphase = \"characterisation\"\nunits = \"all\"\n\
                  staircase = { to_n = 1.0, step_n = 1.0, repeats = 20, rest_s = 300.0 }\n\
                  [[step]]\nphase = \"calibration\"\nunits = [1]\n\
                  staircase = { to_n = 1.0, step_n = 1.0, repeats = 20, rest_s = 300.0 }\n";
    let recipe = plan(&spec, recipe, 1);
    assert_eq!(rehearse(&recipe, &spec).expect("it is simulated").checks.len(), 1, "the one at the end");
}

#[test]
fn changed_load_cell_or_sensor_leaves_the_verdict_undecided() {
    let rig = shipped_text("rigs/sim.toml");
    let gain = |percent: &str| {
        rig.replacen("noise_n = 0.003 }", &format!("noise_n = 0.003, gain_error_percent = {percent} }}"), 1)
    };
    let (more, less) = (gain("30.0"), gain("-30.0"));
    let other = rig.clone() + "\n[[scene.taxel_fault]]\nunit = 5\nkind = \"drifted\"\ngain_percent = -95.0\n";
    for (world, what) in
        [(&more, "outputs for each newton differ by"), (&other, "the pattern of the outputs differs by")]
    {
        assert_ne!(*world, rig);
        let bench = TestFolder::with([("r.toml", TINY)]);
        let output = bench.palpate_ends(0, "run r.toml --out run");
        assert!(output.out.contains("check at the end: outputs for each newton"), "{}", output.out);
        cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 2);
        change_the_world(&bench, "run", world);
        let output = bench.palpate_ends(1, "resume run");
        let said = output.out.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains("check failed at the end: ") && said.contains(what), "{said}");
        assert!(said.contains("presses from 1 on are doubtful") && said.contains("NOT DECIDED"), "{said}");
        assert_eq!(bench.manifest("run")["status"], "complete");
        assert_eq!(bench.manifest("run")["presses_done"], TINY_PRESSES);
        let output = bench.palpate_ends(1, "evaluate run");
        assert!(output.out.contains("NOT DECIDED") && output.err.contains("check failed at the end"), "{}", output.err);
        bench.palpate_ends(0, "verify run");
    }
    // a cell that reads less would press harder: the next press finds it
    let bench = TestFolder::with([("r.toml", TINY)]);
    bench.palpate_ends(0, "run r.toml --out run");
    cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 2);
    change_the_world(&bench, "run", &less);
    let output = bench.palpate_ends(4, "resume run");
    assert!(output.err.contains("safety trip: softer-than-taught: "), "{}", output.err);
    assert_eq!(bench.manifest("run")["presses_done"], 2, "at the next press");
}

#[test]
fn a_recipe_without_checks_makes_none_and_check_counts_them() {
    let none = TINY.replacen('\n', "\nchecks = \"none\"\n", 1);
    let bench = TestFolder::with([("r.toml", TINY), ("none.toml", &none)]);
    assert!(bench.palpate_ends(0, "check r.toml").out.contains("and 1 check at the end, at (0, 0) mm\n"));
    assert!(!bench.palpate_ends(0, "check none.toml").out.contains("check at the end"));
    bench.palpate_ends(0, "run r.toml --out run");
    let output = bench.palpate_ends(0, "run none.toml --out none");
    assert!(!output.out.contains("check"), "{}", output.out);
    for table in ["presses.csv", "calibration_matrix.csv", "test_matrix.csv", "scene.csv"] {
        assert_eq!(bench.read(&format!("run/{table}")), bench.read(&format!("none/{table}")), "{table}");
    }
    assert_eq!(bench.manifest("run")["checks"], 1);
    assert!(bench.manifest("none").get("checks").is_none());
}

#[test]
fn a_verdict_notes_that_a_known_weight_was_not_used_after_the_run() {
    let check = "check = { weight_n = 0.5, weight_u_n = 0.0005, gain = 1.0, gain_sd = 0.0002, times = 3, date = \"2026-05-04\" }";
    let rig = shipped_text("rigs/sim.toml").replacen("lag_ms = 0.0", &format!("{check}\nlag_ms = 0.0"), 1);
    let bench = TestFolder::with([("r.toml", TINY), ("rig.toml", &rig)]);
    let output = bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
    assert!(output.out.contains("the load cell was not checked after the run"), "{}", output.out);
    assert_eq!(bench.manifest("run")["cell_unchecked"], true);
    bench.palpate_ends(0, "run r.toml --out other");
    assert!(bench.manifest("other").get("cell_unchecked").is_none());
}

/// A person with a weight, who may not notice the request for it.
struct CheckWeighing {
    weight: KnownWeight,
    asked: Vec<Ask>,
}

impl Listener for CheckWeighing {
    fn weight(&mut self) -> Option<KnownWeight> {
        Some(self.weight)
    }

    fn ask(&mut self, ask: Ask) {
        self.asked.push(ask);
    }
}

#[test]
fn known_weight_is_requested_after_the_run_for_a_limited_time() {
    for (gain, pressed_n, found) in [(1.0, 0.5, Some(false)), (0.95, 0.5, Some(true)), (1.0, 1e-6, None)] {
        let mut spec = bench("bench-fast");
        let known = KnownWeight { weight_n: 0.5, u_n: 0.0005, pull: false, along: Axis::Z };
        let (gain_sd, date) = (0.0002, "2026-05-04".to_owned());
        let (weight_n, weight_u_n) = (known.weight_n, known.u_n);
        let check =
            WeightCheck { weight_n, weight_u_n, pull: false, gain: 1.0, gain_sd, times: 3, date, adjusted: false };
        spec.load_cell.check = Some(check);
        spec.scene.load_cell.as_mut().expect("a load cell").gain = gain;
        let plan = plan(&spec, TINY, 1);
        let mut person = CheckWeighing { weight: KnownWeight { weight_n: pressed_n, ..known }, asked: Vec::new() };
        let (mut memory, cancel) = (Memory::default(), Cancel::default());
        let ending = run_virtually(async {
            let job = RunJob { plan: &plan, spec: &spec, ledger: &mut memory, cancel: &cancel, shown: &|_| {} };
            execute(job, &mut person).await
        });
        assert_eq!(ending.status(), Status::Complete, "{:?}", ending.text());
        assert_eq!(ending.cell.map(|cell| cell.problem().is_some()), found, "{gain}, {pressed_n}: {:?}", ending.cell);
        assert_eq!(person.asked.len(), if found.is_some() { 6 } else { 1 }, "{:?}", person.asked);
    }
}
