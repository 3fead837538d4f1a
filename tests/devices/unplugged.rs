//! A device is lost during a press: unplugged, silent or garbled from one message on, in any phase. The run ends and names the device, the
//! specimen isn't harmed, recorded presses remain, and the run continues when the device is back.
//!
//! `PALPATE_TESTS=50 cargo test --release --test devices unplugged:: -- --nocapture` loses each device so often in each phase of a press,
//! or at every message if a phase has fewer.

mod far;
mod kept;

use far::{FarEndFate, FarEndLoss};
use kept::{StoredRun, UnpluggedRun};
use palpate_control::Strategy;
use palpate_data::dataset::Status;
use palpate_data::recipe::Plan;
use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::SceneDevice;
use palpate_testing::alone::ran_alone;
use palpate_testing::campaign;
use palpate_testing::executions::{WorstTruth, bench, in_parallel, plan};
use palpate_testing::phases::PressPhase;
use std::collections::BTreeMap;

/// Number of losses of each device in each way and phase.
const LOSSES: usize = 1;

/// One in so many cases is tried, in the quick tier and in the full one: on a bench, and on another rig.
const EVERY: (usize, usize) = (5, 2);
const EVERY_ELSEWHERE: (usize, usize) = (12, 3);

/// Training presses, and presses with a loss: a staircase, a plain one, and a next one to move to.
const TRAINING_PRESSES: usize = 5;
const PRESSES: usize = 3;

/// Extra time of a run with a loss, s: a link is waited for, and parking is tried again.
const LONGER_S: f64 = 120.0;

/// Largest distance of an axis from its parking position, mm: the error of a read-back.
const PARKED_MM: f64 = 0.003;

const RECIPE: &str = r#"
name = "unplugged"
[press]
force_tolerance_n = 0.05
hold_s = 0.25
sample_s = 0.1
strategy = "STRATEGY"
[[step]]
phase = "characterisation"
units = [1]
staircase = { to_n = 1.0, step_n = 1.0, repeats = 1 }
[[step]]
phase = "calibration"
random = { count = 10, x_mm = [-2, 2], y_mm = [-2, 2] }
force_n = 1.0
"#;

/// The rigs that aren't benches.
const ELSEWHERE: [(&str, &str); 4] = [
    ("esp301", include_str!("../../rigs/esp301.toml")),
    ("xps", include_str!("../../rigs/xps.toml")),
    ("grbl", include_str!("../../rigs/grbl.toml")),
    ("process", include_str!("../../rigs/process.toml")),
];

/// A rig, the strategy, and the number of losses there.
#[derive(Clone, Copy, Debug)]
struct UnpluggedSetup {
    rig: &'static str,
    strategy: Strategy,
    losses: usize,
    every: usize,
}

/// A case: the number of a setup, the loss, and its phase.
struct UnpluggedCase {
    setup: usize,
    fate: FarEndFate,
    phase: PressPhase,
}

/// A setup's plan, and its run without a loss.
struct UnpluggedSound {
    setup: UnpluggedSetup,
    spec: RigSpec,
    plan: Plan,
    executed: UnpluggedRun,
}

#[test]
fn device_lost_in_any_phase_of_a_press_ends_the_run_without_loss() {
    // a program that another test starts briefly holds this program's locks, so a released run wouldn't be free
    if ran_alone("unplugged::device_lost_in_any_phase_of_a_press_ends_the_run_without_loss") {
        return;
    }
    let sounds = in_parallel(&setups(), |&setup| UnpluggedSound::of(setup));
    let cases: Vec<UnpluggedCase> = sounds.iter().enumerate().flat_map(|(i, sound)| sound.cases(i)).collect();
    let ends = in_parallel(&cases, |case| sounds[case.setup].lose(case));
    let mut rows: BTreeMap<(&str, FarEndLoss, PressPhase), [usize; 2]> = BTreeMap::new();
    let (mut all, mut longest_s) = (WorstTruth::default(), 0.0f64);
    let mut broken = Vec::new();
    for (case, end) in cases.iter().zip(&ends) {
        let row = rows.entry((case.fate.device.name(), case.fate.loss, case.phase)).or_default();
        row[usize::from(end.ended)] += 1;
        all.join(end.worst);
        longest_s = longest_s.max(end.longer_s);
        let setup = sounds[case.setup].setup;
        broken.extend(end.wrong.iter().map(|wrong| format!("{setup:?} {:?} {:?}: {wrong}", case.fate, case.phase)));
    }
    for ((device, loss, phase), [went_on, ended]) in &rows {
        println!("{device:>9} {loss:?} in {phase:?}: {ended} ended, {went_on} went on to the end");
    }
    println!(
        "{} cases: at most {:.3} N, {:.3} mm, {longest_s:.0} s longer; {} broken",
        cases.len(),
        all.force_n,
        all.depth_mm,
        broken.len()
    );
    assert!(broken.is_empty(), "{} of {} cases:\n{}", broken.len(), cases.len(), broken.join("\n"));
    assert_eq!(rows.len(), 3 * FarEndLoss::ALL.len() * PressPhase::ALL.len(), "each device in each way in each phase");
}

fn setups() -> Vec<UnpluggedSetup> {
    let losses = campaign::size(LOSSES, LOSSES);
    let every = |(quick, full)| campaign::every(quick, full);
    let bench = |rig| {
        let every = every(EVERY);
        Strategy::ALL.map(|strategy| UnpluggedSetup { rig, strategy, losses, every })
    };
    let elsewhere =
        |(rig, _)| UnpluggedSetup { rig, strategy: Strategy::Guarded, losses, every: every(EVERY_ELSEWHERE) };
    let benches = ["bench-fast", "bench-esp301"].into_iter().flat_map(bench);
    benches.chain(ELSEWHERE.into_iter().map(elsewhere)).collect()
}

impl UnpluggedSound {
    fn of(setup: UnpluggedSetup) -> UnpluggedSound {
        let spec = setup.spec();
        let mut plan = plan(&spec, &RECIPE.replace("STRATEGY", setup.strategy.name()), 1);
        plan.entries.truncate(if setup.strategy == Strategy::Map { TRAINING_PRESSES + PRESSES } else { PRESSES });
        let executed = StoredRun::new(&spec, &plan).execute(&spec, &plan, None);
        assert_eq!(executed.ending.status(), Status::Complete, "{setup:?}: {:?}", executed.ending.text());
        assert_eq!(executed.contacts.len(), plan.entries.len(), "{setup:?}");
        for phase in PressPhase::ALL {
            // each press ends above the place of the next one: the first press of a run ends alone, and with a map that is a training press
            let may_miss = phase == PressPhase::Travel && setup.strategy == Strategy::Map;
            assert!(may_miss || executed.phases.contains(&Some(phase)), "{setup:?} has no {phase:?}");
        }
        UnpluggedSound { setup, spec, plan, executed }
    }

    /// Every phase with each device lost in each way, at messages throughout it.
    fn cases(&self, setup: usize) -> Vec<UnpluggedCase> {
        let mut cases = Vec::new();
        let combined: Vec<(SceneDevice, FarEndLoss)> =
            self.devices().into_iter().flat_map(|device| FarEndLoss::ALL.map(|loss| (device, loss))).collect();
        for phase in PressPhase::ALL {
            let messages: Vec<usize> =
                (0..self.executed.phases.len()).filter(|&at| self.executed.phases[at] == Some(phase)).collect();
            let losses = self.setup.losses.min(messages.len());
            for (i, &(device, loss)) in combined.iter().enumerate() {
                // each device in each way at other messages
                let nth = |k: usize| messages[(k * combined.len() + i) * messages.len() / (losses * combined.len())];
                cases.extend((0..losses).map(|k| UnpluggedCase {
                    setup,
                    fate: FarEndFate { device, loss, at: nth(k) },
                    phase,
                }));
            }
        }
        cases.into_iter().skip(setup % self.setup.every).step_by(self.setup.every).collect()
    }

    /// The devices that can be lost separately. A load cell connected to the stage's controller isn't one of them.
    fn devices(&self) -> Vec<SceneDevice> {
        let shared = self.spec.emulators(1).is_ok_and(|rig| rig.load_cell.is_same(&rig.stage));
        SceneDevice::ALL.into_iter().filter(|&device| device != SceneDevice::LoadCell || !shared).collect()
    }

    /// Loses the device, then continues the run on the sound rig; returns all problems.
    fn lose(&self, case: &UnpluggedCase) -> End {
        let UnpluggedSound { spec, plan, .. } = self;
        let mut kept = StoredRun::new(spec, plan);
        let executed = kept.execute(spec, plan, Some(case.fate));
        let mut wrong = self.wrong_with(case, &executed);
        wrong.extend(kept.wrong_on_disk(&executed.ending, &executed.contacts, plan));
        let ended = executed.ending.halt.is_some();
        if ended {
            kept = kept.reopen(spec);
            let resumed = kept.execute(spec, plan, None);
            if resumed.ending.status() != Status::Complete {
                wrong.push(format!("resumed, it ended {:?}", resumed.ending.text()));
            }
            if !resumed.worst.is_within(spec) {
                wrong.push(format!("resumed: {:?}", resumed.worst));
            }
            let contacts = [&executed.contacts[..], &resumed.contacts].concat();
            wrong.extend(kept.wrong_on_disk(&resumed.ending, &contacts, plan).map(|wrong| format!("resumed: {wrong}")));
        }
        let longer_s = executed.virtual_s - self.executed.virtual_s;
        End { ended, worst: executed.worst, longer_s, wrong }
    }

    /// Problems of a run in which a device was lost.
    fn wrong_with(&self, case: &UnpluggedCase, executed: &UnpluggedRun) -> Vec<String> {
        let FarEndFate { device, at, .. } = case.fate;
        let UnpluggedRun { ending, worst, z_mm, at_rest, .. } = executed;
        let mut wrong = Vec::new();
        let mut check = |right: bool, text: String| wrong.extend((!right).then_some(text));
        check(executed.phases.get(at) == Some(&Some(case.phase)), "it struck in another phase".to_owned());
        check(executed.virtual_s < self.executed.virtual_s + LONGER_S, format!("it took {:.0} s", executed.virtual_s));
        check(worst.is_within(&self.spec), format!("{worst:?}"));
        check(*at_rest, "an axis moves on".to_owned());
        check(self.executed.contacts.starts_with(&executed.contacts), "what was recorded is another".to_owned());
        let must_park = device != SceneDevice::Stage || ending.unparked.is_none();
        let parked = *z_mm <= self.spec.clear_mm() + PARKED_MM;
        check(!must_park || parked, format!("it isn't parked: z is {z_mm} mm, {:?}", ending.text()));
        check(device == SceneDevice::Stage || ending.unparked.is_none(), format!("not parked: {:?}", ending.text()));
        match &ending.halt {
            None => check(executed.contacts.len() == self.plan.entries.len(), "it ended too soon".to_owned()),
            Some(_) => {
                let failed = matches!(ending.status(), Status::Failed | Status::Tripped);
                check(failed, format!("{:?}", ending.status()));
                let output = ending.text().unwrap_or_default();
                // a message about parking names the stage in any case
                let halted = output.split("; the stage could not be parked").next().unwrap_or_default();
                let shared = self.devices().len() < SceneDevice::ALL.len();
                let names: &[&str] = match device {
                    SceneDevice::Stage if shared => &["stage", "load cell"],
                    SceneDevice::Stage => &["stage"],
                    SceneDevice::LoadCell => &["load cell"],
                    SceneDevice::Array => &["array"],
                };
                check(names.iter().any(|name| halted.contains(name)), format!("it says {output:?}"));
            }
        }
        wrong
    }
}

/// Result of a case.
struct End {
    /// Whether the loss ended the run.
    ended: bool,
    worst: WorstTruth,
    /// Its extra time compared with a sound run, s.
    longer_s: f64,
    wrong: Vec<String>,
}

impl UnpluggedSetup {
    fn spec(&self) -> RigSpec {
        match ELSEWHERE.iter().find(|(name, _)| *name == self.rig) {
            None => bench(self.rig),
            Some((name, text)) => {
                rig::parse(name, text, &|_| unreachable!("no map of its own")).expect("the shipped rig").simulated()
            }
        }
    }
}
