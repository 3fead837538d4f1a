//! Every fault, alone and with every other, on both benches, at any time of a run: no fault of load cell, specimen or link may exceed the
//! specimen's limits. Judged by the true values from the first message until all is at rest.

use palpate_control::{Reaction, Strategy, safe_speed_mm_s};
use palpate_core::quantity::stream;
use palpate_data::dataset::RecordedContact;
use palpate_data::recipe::Plan;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{FaultKind, SceneFault};
use palpate_testing::campaign;
use palpate_testing::executions::{
    BENCHES, ExecutedRun, WorstTruth, bench, end_of, executed, in_parallel, must_be_none, plan,
};
use rand::RngExt;
use std::collections::BTreeMap;

/// The quick tier makes one in so many runs of a seed. The number divides neither that of rigs nor that of speeds.
const THINNED_BY: usize = 5;

/// Seeds of each fault, rig and speed in the full tier, for presses with the map; for the others; for each pair of faults.
const SEEDS: usize = 20;
const OTHER_SEEDS: usize = 4;
const PAIR_SEEDS: usize = 3;
const OTHER_PAIR_SEEDS: usize = 1;

/// Speeds of the stage, mm/s; the last one is that of the benches.
const SPEEDS_MM_S: [f64; 4] = [0.5, 2.0, 5.0, 25.0];
const OTHER_SPEEDS_MM_S: [f64; 2] = [2.0, 25.0];
const PAIR_SPEED_MM_S: f64 = 5.0;

/// One in so many seeds has its fault before the first press.
const EARLY: u64 = 5;

/// Presses of a plan: training presses and ordinary ones; fewer where each takes long.
const TRAINING_PRESSES: usize = 5;
const ORDINARY: usize = 5;
const ORDINARY_SLOW: usize = 2;
const SLOW_MM_S: f64 = 1.0;

/// Window of the plans, s.
const WINDOW_S: f64 = 0.1;

/// Longest contact after the beginning of its window, s, except for the retraction: the window, the command, acceleration and braking.
const LEAVES_S: f64 = WINDOW_S + 0.2;

/// Largest error of a recorded force with an unnoticed fault, N, and with ten times the noise; 1.2 and 9.5 mN were the largest. By the
/// record the force is within the tolerance of the plans, N.
const RECORDED_N: f64 = 0.0015;
const NOISIER: f64 = 10.0;
const TOLERANCE_N: f64 = 0.010;

/// Largest extra time of a run with a fault, s: a silent link is waited for, and parking is tried again.
const LONGER_S: f64 = 120.0;

/// One run.
#[derive(Clone, Debug)]
struct FaultCase {
    bench: &'static str,
    speed_mm_s: f64,
    strategy: Strategy,
    force_n: f64,
    kinds: Vec<FaultKind>,
    seed: u64,
}

/// Its result.
struct FaultOutcome {
    case: FaultCase,
    faults: Vec<SceneFault>,
    worst: WorstTruth,
    end: &'static str,
    text: Option<String>,
    virtual_s: f64,
    longer_s: f64,
    ready_s: f64,
    kept: StoredPress,
}

/// Results of the recorded presses.
#[derive(Default)]
struct StoredPress {
    /// Times when their windows began, s.
    windows_s: Vec<f64>,
    /// Largest differences of the true force from the set one and from the recorded one, in rows without a flag, N.
    off_n: f64,
    recorded_n: f64,
}

impl StoredPress {
    fn of<'a>(contacts: impl Iterator<Item = &'a RecordedContact>) -> StoredPress {
        contacts.fold(StoredPress::default(), |mut kept, contact| {
            let (press, truth) = (&contact.levels[0], &contact.truth[0]);
            kept.windows_s.extend(press.t_s);
            if !press.is_flagged() {
                let off_n = |force_n: Option<f64>| (truth.force_true_n - force_n.expect("a force")).abs();
                kept.off_n = kept.off_n.max(off_n(press.force_set_n));
                kept.recorded_n = kept.recorded_n.max(off_n(press.force_n));
            }
            kept
        })
    }
}

impl FaultCase {
    fn spec(&self) -> RigSpec {
        let mut spec = bench(self.bench);
        spec.stage.speed_mm_s = self.speed_mm_s;
        spec
    }

    /// Presses near each other, so that the ways between them are short; few except the training presses.
    fn plan(&self, spec: &RigSpec) -> Plan {
        let (strategy, force_n) = (self.strategy.name(), self.force_n);
        let text = format!(
            "name = \"faults\"\n[press]\nforce_tolerance_n = 0.01\nhold_s = 0.0\nsample_s = 0.1\n\
             strategy = \"{strategy}\"\n[[step]]\nphase = \"calibration\"\n\
             random = {{ count = 10, x_mm = [-0.4, 0.4], y_mm = [-0.4, 0.4] }}\nforce_n = {force_n:?}\n"
        );
        let mut plan = plan(spec, &text, self.seed);
        let ordinary = if self.speed_mm_s < SLOW_MM_S { ORDINARY_SLOW } else { ORDINARY };
        plan.entries.truncate(if self.strategy == Strategy::Map { TRAINING_PRESSES + ordinary } else { ordinary });
        plan
    }

    /// The same without its faults.
    fn sound(&self) -> FaultCase {
        FaultCase { kinds: Vec::new(), seed: 0, ..self.clone() }
    }

    fn key(&self) -> String {
        format!("{} at {} mm/s, {}, {} N", self.bench, self.speed_mm_s, self.strategy.name(), self.force_n)
    }

    /// A run for each fault, which begins at any time of a sound run.
    fn run(&self, sound: &FaultSound) -> FaultOutcome {
        let mut spec = self.spec();
        let plan = self.plan(&spec);
        let mut rng = stream(self.seed, 0, "onset");
        let from_to_s =
            if self.seed.is_multiple_of(EARLY) { (0.0, sound.ready_s) } else { (sound.ready_s, sound.virtual_s) };
        let mut fault = |&kind| SceneFault { kind, from_s: rng.random_range(from_to_s.0..from_to_s.1), value: None };
        spec.scene.faults = self.kinds.iter().map(&mut fault).collect();
        let ExecutedRun { ending, truth, virtual_s, ledger, .. } = &executed(&spec, &plan);
        FaultOutcome {
            case: self.clone(),
            faults: spec.scene.faults.clone(),
            worst: *truth,
            end: end_of(ending),
            text: ending.text(),
            virtual_s: *virtual_s,
            longer_s: virtual_s - sound.virtual_s,
            ready_s: sound.ready_s,
            kept: StoredPress::of(ledger.contacts()),
        }
    }

    /// Whether this speed is safe on the specimen that the fault puts in place (I3), which the rig declares.
    fn is_judged(&self) -> bool {
        let spec = self.spec();
        let hard = self.kinds.contains(&FaultKind::HardContact);
        !hard || self.speed_mm_s <= hard_speed_mm_s(&spec)
    }
}

/// Fastest approach that stays within the force limit on a hard contact, mm/s.
fn hard_speed_mm_s(spec: &RigSpec) -> f64 {
    let latencies = &spec.scene.latencies;
    let reaction = Reaction {
        conversion_s: 1.0 / spec.load_cell.conversions_hz,
        load_cell_s: latencies.load_cell_s.1,
        stage_s: latencies.stage_s.1,
        lag_s: spec.load_cell.lag_s,
    };
    let hard_n_mm = FaultKind::HardContact.usual().expect("a stiffness");
    safe_speed_mm_s(spec.limits.force_n - 0.03, hard_n_mm, reaction.worst_s(), spec.stage.acceleration_mm_s2)
}

/// Result of a run without faults.
struct FaultSound {
    ready_s: f64,
    virtual_s: f64,
}

fn name(kind: FaultKind) -> &'static str {
    FaultKind::ALL.iter().find(|(_, other)| *other == kind).expect("a kind").0
}

fn named(kinds: &[FaultKind]) -> String {
    kinds.iter().map(|&kind| name(kind)).collect::<Vec<_>>().join(" + ")
}

/// Runs all cases, and compares each with a sound run of its rig, speed and strategy.
fn run_all(cases: &[FaultCase]) -> Vec<FaultOutcome> {
    let sound_cases: BTreeMap<String, FaultCase> = cases.iter().map(|case| (case.key(), case.sound())).collect();
    let (keys, sound_cases): (Vec<String>, Vec<FaultCase>) = sound_cases.into_iter().unzip();
    let sounds = in_parallel(&sound_cases, |case| {
        let spec = case.spec();
        let ExecutedRun { ending, ready_s, virtual_s, .. } = executed(&spec, &case.plan(&spec));
        assert!(ending.halt.is_none() && ending.unparked.is_none(), "{}: {:?}", case.key(), ending.text());
        FaultSound { ready_s, virtual_s }
    });
    let sounds: BTreeMap<String, FaultSound> = keys.into_iter().zip(sounds).collect();
    in_parallel(cases, |case| case.run(&sounds[&case.key()]))
}

fn cases(kinds: &[Vec<FaultKind>], speeds: &[f64], strategy: Strategy, force_n: f64, seeds: usize) -> Vec<FaultCase> {
    let (seeds, is_quick) = (campaign::size(1, seeds) as u64, campaign::is_quick());
    let mut cases = Vec::new();
    for kinds in kinds {
        for (bench, _) in BENCHES {
            for &speed_mm_s in speeds {
                for seed in 1..=seeds {
                    // with one seed, the faults of all runs would begin at one place
                    let seed = if is_quick { 1 + cases.len() as u64 } else { seed };
                    cases.push(FaultCase { bench, speed_mm_s, strategy, force_n, kinds: kinds.clone(), seed });
                }
            }
        }
    }
    if is_quick {
        cases = cases.into_iter().step_by(THINNED_BY).collect();
        println!("thinned to {} runs", cases.len());
    }
    cases
}

/// The kinds whose force the limits bound at once. A factor on the readings of the load cell or of the array shows in comparisons with
/// earlier presses, see `sparse_plans`.
pub(crate) fn bounded() -> Vec<FaultKind> {
    let is_factor = |kind: &FaultKind| matches!(kind, FaultKind::LostGain | FaultKind::ScaledOutputs);
    FaultKind::ALL.iter().map(|&(_, kind)| kind).filter(|kind| !is_factor(kind)).collect()
}

fn singles() -> Vec<Vec<FaultKind>> {
    bounded().into_iter().map(|kind| vec![kind]).collect()
}

fn pairs() -> Vec<Vec<FaultKind>> {
    let all = bounded();
    let all = &all;
    let pair = |i: usize| (0..i).map(move |j| vec![all[j], all[i]]);
    (0..all.len()).flat_map(pair).collect()
}

/// One line for each fault: number of runs, exceeded limits, peaks, ends. Returns the runs that exceed a limit without permission.
fn report(outcomes: &[FaultOutcome]) -> Vec<String> {
    let mut rows: BTreeMap<String, Vec<&FaultOutcome>> = BTreeMap::new();
    for outcome in outcomes {
        rows.entry(named(&outcome.case.kinds)).or_default().push(outcome);
    }
    let mut broken = Vec::new();
    for (kinds, outcomes) in &rows {
        let limits = outcomes[0].case.spec().limits;
        let (judged, printed): (Vec<&&FaultOutcome>, Vec<&&FaultOutcome>) =
            outcomes.iter().partition(|o| o.case.is_judged());
        let count = |over: &dyn Fn(&WorstTruth) -> bool| judged.iter().filter(|o| over(&o.worst)).count();
        let over = [
            count(&|w| w.force_n > limits.force_n),
            count(&|w| w.depth_mm > limits.depth_mm),
            count(&|w| w.slid_mm > 0.0),
        ];
        let worst = worst_of(judged.iter().map(|o| o.worst));
        let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
        outcomes.iter().for_each(|o| *ends.entry(o.end).or_default() += 1);
        let longest_s = outcomes.iter().map(|o| o.longer_s).fold(f64::NEG_INFINITY, f64::max);
        let noticed = 100 * outcomes.iter().filter(|o| o.end != "-").count() / outcomes.len();
        println!(
            "{kinds}: {} runs, {over:?} over force, depth, slid; {:.3} N, {:.3} mm; \
             {longest_s:+.0} s; noticed {noticed} %: {ends:?}",
            judged.len(),
            worst.force_n,
            worst.depth_mm,
        );
        if !printed.is_empty() {
            let mut speeds: BTreeMap<String, WorstTruth> = BTreeMap::new();
            for o in printed.iter() {
                let key = format!("{} at {} mm/s", o.case.bench, o.case.speed_mm_s);
                speeds.entry(key).or_default().join(o.worst);
            }
            let output = |(key, w): (&String, &WorstTruth)| {
                format!("{key}: {:.2} N, {:.2} mm, slid {}", w.force_n, w.depth_mm, w.slid_mm)
            };
            println!("    faster than is safe there: {}", speeds.iter().map(output).collect::<Vec<_>>().join("; "));
        }
        broken.extend(judged.iter().filter(|o| !o.worst.is_within(&o.case.spec())).map(|o| o.text()));
        // at any speed, a hard contact is no deeper and nothing slides
        let deep = |o: &&&&FaultOutcome| o.worst.depth_mm > limits.depth_mm || o.worst.slid_mm > 0.0;
        broken.extend(printed.iter().filter(deep).map(|o| o.text()));
    }
    broken
}

fn worst_of(all: impl Iterator<Item = WorstTruth>) -> WorstTruth {
    all.fold(WorstTruth::default(), |mut worst, other| {
        worst.join(other);
        worst
    })
}

/// Rules by which a fault may be noticed; `device` is a driver that gives up before a rule is checked.
fn fitting(kind: FaultKind) -> &'static [&'static str] {
    match kind {
        // a cell that sticks before it is zeroed has no noise, so equal readings show nothing
        FaultKind::Stuck => &["frozen", "no-response", "no-contact"],
        // before the first touch the array detects it; a reading during which it begins is a mean of both
        FaultKind::NoSensor => &["fallen", "no-response", "no-contact", "outputs-moved", "softer-than-taught"],
        FaultKind::NoContact => &["fallen", "no-response", "no-contact"],
        // between two readings of a contact the force seems to disappear; a reading during which it begins is a mean of both signs
        FaultKind::WrongSign => &["wrong-sign", "jumped", "no-response", "fallen", "softer-than-taught"],
        FaultKind::Saturated => &["saturated", "frozen", "no-response"],
        // a specimen that slips before it touches feels softer than it can be
        FaultKind::Slip => &["fallen", "no-response", "out-of-reach", "softer-than-taught"],
        FaultKind::HardContact => &["hard-contact", "over-force"],
        FaultKind::Stale => &["stale", "device"],
        FaultKind::StageLost => &["stage-silent", "device", "unparked"],
        FaultKind::ArrayLost => &["device"],
        FaultKind::SlowStage => &["stage-silent"],
        // in contact, ten times the noise can look like any change of the force
        FaultKind::Noisy => &[
            "noisy",
            "wrong-sign",
            "no-response",
            "fallen",
            "hard-contact",
            "rises-at-rest",
            "softer-than-taught",
            "still-touching",
        ],
        // a loss of half a newton during a press can have any cause
        FaultKind::DriftedZero => {
            &["zero-drifted", "jumped", "wrong-sign", "no-response", "fallen", "softer-than-taught"]
        }
        FaultKind::RollsOver => &["jumped"],
        // no rig file can state it: `wire_faults` does; the others aren't tried here
        FaultKind::Risen | FaultKind::LostGain | FaultKind::ScaledOutputs => &[],
    }
}

impl FaultOutcome {
    /// Whether the end of the run fits its fault. An unnoticed fault must have begun too late, or be harmless, and every recorded press
    /// must be right.
    fn is_fitting(&self) -> bool {
        if self.end != "-" {
            return fitting(self.case.kinds[0]).contains(&self.end);
        }
        let recorded_n = if self.case.kinds[0] == FaultKind::Noisy { NOISIER } else { 1.0 } * RECORDED_N;
        self.may_be_missed() && self.kept.recorded_n <= recorded_n && self.kept.off_n <= TOLERANCE_N + recorded_n
    }

    /// Whether the fault couldn't harm a press of this run.
    fn may_be_missed(&self) -> bool {
        let from_s = self.faults[0].from_s;
        let windows_s = &self.kept.windows_s;
        let begun_after = |nth_last: usize| windows_s.len().checked_sub(nth_last).is_none_or(|n| from_s > windows_s[n]);
        match self.case.kinds[0] {
            // the zero contains it
            FaultKind::Noisy | FaultKind::DriftedZero if from_s < self.ready_s => true,
            // noise is compared with that of the zero before a press, and the specimen changes from the next contact on
            FaultKind::Noisy | FaultKind::HardContact => begun_after(2),
            // one contact slips, once, after its window
            FaultKind::Slip => {
                let spec = self.case.spec();
                let leaves_s = LEAVES_S + spec.limits.depth_mm / spec.stage.speed_mm_s;
                begun_after(1) || windows_s.iter().any(|at_s| (0.0..leaves_s).contains(&(from_s - at_s)))
            }
            // a stage that can't be parked is reported, although all presses were made
            FaultKind::StageLost => from_s >= self.virtual_s,
            // slower answers only cost time
            FaultKind::SlowStage => true,
            _ => begun_after(1),
        }
    }

    fn text(&self) -> String {
        let faults = self.faults.iter().map(|fault| format!("{} from {:.3} s", name(fault.kind), fault.from_s));
        let FaultOutcome { case, worst, .. } = self;
        let WorstTruth { force_n, depth_mm, slid_mm, .. } = worst;
        format!(
            "{}: {}, seed {}: {force_n:.3} N, {depth_mm:.3} mm, slid {slid_mm} mm, {:.0} s: {}",
            faults.collect::<Vec<_>>().join(", "),
            case.key(),
            case.seed,
            self.virtual_s,
            self.text.as_deref().unwrap_or("the plan was done"),
        )
    }
}

#[test]
fn no_fault_exceeds_a_limit_and_each_trips_a_fitting_rule() {
    let mut all = Vec::new();
    for (strategy, speeds_mm_s, seeds) in [
        (Strategy::Map, &SPEEDS_MM_S[..], SEEDS),
        (Strategy::Guarded, &OTHER_SPEEDS_MM_S, OTHER_SEEDS),
        (Strategy::Velocity, &OTHER_SPEEDS_MM_S, OTHER_SEEDS),
    ] {
        println!("-- {}", strategy.name());
        let outcomes = run_all(&cases(&singles(), speeds_mm_s, strategy, 1.0, seeds));
        report(&outcomes);
        all.extend(outcomes);
    }
    println!("-- all");
    let broken = report(&all);
    let long: Vec<String> = all.iter().filter(|o| o.longer_s > LONGER_S).map(FaultOutcome::text).collect();
    let unfitting: Vec<String> = all.iter().filter(|o| !o.is_fitting()).map(FaultOutcome::text).collect();
    must_be_none(&[broken, long, unfitting].concat());
}

#[test]
fn no_two_faults_exceed_a_limit() {
    let mut all = Vec::new();
    for (strategy, seeds) in
        [(Strategy::Map, PAIR_SEEDS), (Strategy::Guarded, OTHER_PAIR_SEEDS), (Strategy::Velocity, OTHER_PAIR_SEEDS)]
    {
        all.extend(run_all(&cases(&pairs(), &[PAIR_SPEED_MM_S], strategy, 1.0, seeds)));
    }
    must_be_none(&report(&all));
}

/// At the force limit, a cell that reads wrong leaves only the depth limit, and the force there may exceed the force limit.
#[test]
fn press_at_the_limit_keeps_its_depth_with_a_faulty_load_cell() {
    const LYING: [FaultKind; 6] = [
        FaultKind::Stuck,
        FaultKind::NoSensor,
        FaultKind::WrongSign,
        FaultKind::Saturated,
        FaultKind::Noisy,
        FaultKind::DriftedZero,
    ];
    let kinds: Vec<Vec<FaultKind>> = LYING.iter().map(|&kind| vec![kind]).collect();
    let outcomes = run_all(&cases(&kinds, &[5.0], Strategy::Map, 2.0, OTHER_SEEDS));
    let spec = bench(BENCHES[0].0);
    let branches_n: f64 = spec.scene.relaxation.iter().map(|branch| branch.share).sum();
    let at_limit_n = (1.0 + branches_n) * spec.scene.contact.force_n(spec.limits.depth_mm);
    println!("at the depth limit the nominal curve bears {at_limit_n:.3} N to a sudden load");
    report(&outcomes);
    let deep = outcomes.iter().filter(|o| o.worst.depth_mm > spec.limits.depth_mm || o.worst.slid_mm > 0.0);
    must_be_none(&deep.map(FaultOutcome::text).collect::<Vec<_>>());
}
