//! Stages that forget where they are: boards that restart in every form after every byte of a press, and boards with a second host.
//!
//! A motion is a displacement, so what a board forgets or somebody else sets changes no end point. Judged by the true values.
//! `PALPATE_TESTS=full` restarts after each byte.

use super::families::{
    ARM, DECLARED_N_MM, ESP301, Family, GRBL, KLIPPER, KLIPPER_THAT_HOLDS, LEFT_N, LIMIT_N, MARLIN, PROGRAM, When, XPS,
};
use palpate_core::quantity::{Axis, stream};
use palpate_sim::emulator::{
    EspFaultKind, GrblFaultKind, GrblWelcome, KlipperFaultKind, MarlinAnnounced, MarlinFaultKind,
    ProcessStageFaultKind, UrFaultKind, XpsFaultKind,
};
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, ExecutedRun, end_of, executed_with, in_parallel, must_be_none};
use rand::RngExt;
use std::collections::BTreeMap;
use std::fmt::Debug;

/// Largest true force of the stage's own motions, in limits.
const MOST: f64 = 1.1;

/// Runs of a form: quick, and full where a press has more bytes than this. The boards of printers restart after each byte.
const RUNS: (usize, usize) = (4, 500);
const RUNS_OF_PRINTERS: (usize, usize) = (6, 3000);

/// How long before its end a run doesn't see what begins, s: z goes .4 mm at 5 mm/s until it touches.
const UNSEEN_S: f64 = 0.1;

/// Interval of the faults before that, s.
const LAST_QUESTIONS_EVERY_S: f64 = 0.01;

impl<K: Copy + Debug + Send + Sync> Family<K> {
    fn run(&self, fault: Option<(When, K)>) -> ExecutedRun {
        let spec = self.over_specimen();
        executed_with(&spec, &self.press(&spec), Deaths::Ignored, &|rig| self.install(&spec, rig, fault))
    }

    /// Gives the stage a fault after some bytes of a run, each in the full tier, and at some times of it. Prints how the runs end, and checks
    /// the force during them and after them.
    fn check(&self, kind: K, moves_itself_n: f64) {
        self.check_within(kind, moves_itself_n, moves_itself_n);
    }

    /// The same with what may be left on the specimen, N, where nothing moves the stage any more.
    fn check_within(&self, kind: K, moves_itself_n: f64, left_n: f64) {
        let sound = self.run(None);
        assert!(sound.ending.halt.is_none(), "{}: {:?}", self.rig, sound.ending.text());
        let (quick, full) =
            if [MARLIN.rig, GRBL.rig, KLIPPER.rig].contains(&self.rig) { RUNS_OF_PRINTERS } else { RUNS };
        let count = campaign::size(quick, full.min(sound.bytes as usize));
        let mut rng = stream(1, 0, "when a stage forgets");
        let mut whens: Vec<When> = (0..count as u64)
            .map(|nth| if count as u64 >= sound.bytes { nth + 1 } else { rng.random_range(1..=sound.bytes) })
            .map(When::AfterBytes)
            .collect();
        let seen_until_s = sound.virtual_s - UNSEEN_S - self.begins_s;
        whens.extend((0..count / 2).map(|_| When::At(rng.random_range(sound.ready_s..seen_until_s))));
        // between the last questions of a run, of which a printer answers each when all that it has queued has ended
        whens
            .extend((0..campaign::size(4, 40)).map(|nth| When::At(seen_until_s - LAST_QUESTIONS_EVERY_S * nth as f64)));
        let outcomes = in_parallel(&whens, |&when| {
            let run = self.run(Some((when, kind)));
            (run.truth.force_n, run.left_n, end_of(&run.ending), run.ending.text())
        });
        let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
        outcomes.iter().for_each(|(_, _, end, _)| *ends.entry(end).or_default() += 1);
        let (most_n, rest_n) = outcomes
            .iter()
            .fold((0.0f64, 0.0f64), |(most, left), (force, rest, ..)| (most.max(*force), left.max(*rest)));
        println!(
            "{} {kind:?}: {} runs, largest force {most_n:.3} N, {rest_n:.3} N left, ends {ends:?}",
            self.rig,
            whens.len()
        );
        let is_over =
            |(force_n, rest_n): (f64, f64)| force_n > MOST * LIMIT_N + moves_itself_n || rest_n > LEFT_N + left_n;
        let broken = whens.iter().zip(&outcomes).filter(|(_, (force_n, left_n, ..))| is_over((*force_n, *left_n)));
        let broken = broken.map(|(when, outcome)| format!("{when:?} {kind:?}: {outcome:?}"));
        must_be_none(&broken.collect::<Vec<_>>());
    }
}

#[test]
fn a_marlin_that_restarts_in_any_form_presses_no_harder_and_lets_go() {
    use MarlinAnnounced::{Cut, Damaged, EchoStart, Silent, Start, Stray, WithinAnswer};
    for announced in [Start, EchoStart, Stray, Damaged, WithinAnswer, Cut, Silent] {
        MARLIN.check(MarlinFaultKind::Restart(announced), 0.0);
    }
}

#[test]
fn a_marlin_with_lost_doubled_or_endless_answers_or_jumping_counts_presses_no_harder() {
    use MarlinFaultKind::{Busy, CountsJump, DoubledOk, LostOk};
    for kind in [LostOk, DoubledOk] {
        MARLIN.check(kind, 0.0);
    }
    // a board whose count jumps between the zero and the line of a motion goes that much farther by itself
    MARLIN.check(CountsJump([0, 0, 400]), 1.0 * DECLARED_N_MM);
    // it is busy for ever: nothing can move it
    MARLIN.check_within(Busy, 0.0, LIMIT_N);
}

#[test]
fn a_marlin_with_a_second_host_presses_no_harder() {
    for lines in ["G92 Z0", "G91", "G20"] {
        MARLIN.check(MarlinFaultKind::Other(lines), 0.0);
    }
    // it moves itself by 0.5 mm, or babysteps by 0.2 mm
    MARLIN.check(MarlinFaultKind::Other("G91\nG1 Z-0.5 F300"), 0.5 * DECLARED_N_MM);
}

/// What a second host moves down at 5 mm/s, and how far that goes, mm, beyond the force of the last resort: for 110 ms of readings and messages,
/// and until it has braked.
const JOG_UNTIL_STOPPED_MM: f64 = 0.7;
const JOG: &str = "G91\nG1 Z-4 F300";
const MOVEL: &str = "def job():\n movel(pose_add(get_actual_tcp_pose(), p[0,0,-0.004,0,0,0]), a=0.1, v=0.005)\nend\n";

#[test]
fn the_last_resort_ends_a_long_jog_of_a_second_host() {
    let most_n = JOG_UNTIL_STOPPED_MM * DECLARED_N_MM;
    MARLIN.check(MarlinFaultKind::Other(JOG), most_n);
    GRBL.check(GrblFaultKind::Other(JOG), most_n);
    ARM.check(UrFaultKind::Other(MOVEL), most_n);
    ESP301.check(EspFaultKind::Other("3VA5;3PR-4"), most_n);
    // it can't free the tip without power
    KLIPPER_THAT_HOLDS.check_within(KlipperFaultKind::Other(JOG), most_n, f64::INFINITY);
}

#[test]
fn a_grbl_homed_by_hand_that_restarts_in_any_form_presses_no_harder_and_lets_go() {
    use GrblWelcome::{Clean, Damaged, Lost, Stray};
    for welcome in [Clean, Damaged, Stray, Lost] {
        GRBL.check(GrblFaultKind::Restart(welcome), 0.0);
    }
    for kind in [GrblFaultKind::LostOk, GrblFaultKind::DoubledOk, GrblFaultKind::CountsJump([0, 0, 250])] {
        GRBL.check(kind, 0.0);
    }
    for lines in ["G92 Z0", "G91", "G20", "G10 L20 P1 Z0"] {
        GRBL.check(GrblFaultKind::Other(lines), 0.0);
    }
}

#[test]
fn a_klipper_that_restarts_or_has_a_second_client_presses_no_harder_and_lets_go() {
    for kind in [KlipperFaultKind::McuRestart, KlipperFaultKind::IdleTimeout] {
        KLIPPER.check(kind, 0.0);
    }
    for script in ["G92 Z0", "G91", "SET_KINEMATIC_POSITION Z=100", "SET_GCODE_OFFSET Z=1"] {
        KLIPPER.check(KlipperFaultKind::Other(script), 0.0);
    }
}

#[test]
fn an_esp301_that_restarts_is_mirrored_or_has_a_second_host_presses_no_harder() {
    use EspFaultKind::{DoubledAnswer, LostAnswer, Mirrored, NeverDone, Other, Restart};
    for kind in [LostAnswer, DoubledAnswer, Restart { motors_on: true, takes_s: 3.0 }, Other("3DH0"), Other("3PA-20")] {
        ESP301.check(kind, 0.0);
    }
    // its motors are off, or it is said to move for ever
    for kind in [Restart { motors_on: false, takes_s: 3.0 }, NeverDone] {
        ESP301.check_within(kind, 0.0, LIMIT_N);
    }
    // the way out of a press has the rig's speed, at which it goes 1.3 mm until it rests
    ESP301.check_within(Mirrored(Axis::Z), 1.3 * DECLARED_N_MM, f64::INFINITY);
}

#[test]
fn an_xps_that_restarts_or_has_a_second_client_presses_no_harder() {
    use XpsFaultKind::{DoubledAnswer, LostAnswer, Restart};
    for kind in [LostAnswer, DoubledAnswer] {
        XPS.check(kind, 0.0);
    }
    // no group is initialised afterwards: nothing moves
    XPS.check_within(Restart { takes_s: 3.0 }, 0.0, LIMIT_N);
}

#[test]
fn an_arm_whose_tcp_another_client_moves_presses_no_harder() {
    for program in
        ["sec tool():\n set_tcp(p[0,0,0.01,0,0,0])\nend\n", "sec tool():\n set_tcp(p[0,0,-0.01,0,0,0])\nend\n"]
    {
        ARM.check(UrFaultKind::Other(program), 0.0);
    }
}

#[test]
fn a_program_that_forgets_or_ignores_presses_no_harder() {
    use ProcessStageFaultKind::{
        CountsJump, DoubledAnswer, IgnoresStop, LosesCount, LostAnswer, NeverDone, Restart, ToIsRelative,
    };
    for kind in [LostAnswer, DoubledAnswer, LosesCount, CountsJump([0.0, 0.0, 1.0]), IgnoresStop, ToIsRelative] {
        PROGRAM.check(kind, 0.0);
    }
    // it is said to move for ever, or isn't prepared
    for kind in [NeverDone, Restart] {
        PROGRAM.check_within(kind, 0.0, LIMIT_N);
    }
}
