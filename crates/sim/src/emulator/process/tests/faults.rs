//! Faults of a stage of the process protocol, line by line.

use super::*;
use ProcessStageFaultKind::{
    CountsJump, DoubledAnswer, IgnoresStop, LosesCount, LostAnswer, NeverDone, Other, Restart, ToIsRelative,
};

const STATUS: &str = r#"{"id": 5, "do": "status"}"#;
const DOWN: &str = r#"{"id": 3, "do": "move", "by_mm": {"z": -1}, "speed_mm_s": 10}"#;
const TO_11: &str = r#"{"id": 3, "do": "move", "to_mm": {"z": 11}, "speed_mm_s": 10}"#;
const DONE: &str = r#"{"id":3}"#;

/// A prepared stage at the end of z, 12.5 mm, with a fault at 20 s.
fn failing(kind: ProcessStageFaultKind) -> (ProcessStageEmulator, Scene) {
    let (stage, scene) = prepared();
    (stage.with_faults(&[ProcessStageFault { from_s: 20.0, kind }], &[]), scene)
}

fn at(moving: bool, z_mm: f64) -> String {
    format!(r#"{{"id":5,"moving":{moving},"position_mm":{{"x":0.0,"y":0.0,"z":{z_mm:?}}}}}"#)
}

/// Carries out some requests at their times and compares the answers.
fn script(stage: &mut ProcessStageEmulator, scene: &mut Scene, steps: &[(f64, &str, &str)]) {
    for &(now_s, asked, answered) in steps {
        assert_eq!(ask(stage, scene, now_s, asked), answered, "{asked} at {now_s} s");
    }
}

#[test]
fn an_answer_is_lost_or_doubled_and_its_request_carried_out() {
    for (kind, answer) in [(LostAnswer, String::new()), (DoubledAnswer, format!("{DONE}\n{DONE}"))] {
        let (mut stage, mut scene) = failing(kind);
        script(&mut stage, &mut scene, &[(20.0, DOWN, &answer), (21.0, STATUS, &at(false, 11.5)), (21.0, DOWN, DONE)]);
    }
}

#[test]
fn a_lost_count_begins_at_zero_and_its_targets_are_other_places() {
    let (mut stage, mut scene) = failing(LosesCount);
    script(
        &mut stage,
        &mut scene,
        &[(20.0, STATUS, &at(false, 0.0)), (20.0, DOWN, DONE), (22.0, STATUS, &at(false, -1.0))],
    );
    assert_eq!(scene.axis(Axis::Z, 22.0).0, 11.5);
    // the end of the frame stops it
    script(&mut stage, &mut scene, &[(22.0, TO_11, DONE)]);
    assert_eq!(scene.axis(Axis::Z, 30.0).0, 12.5);
    let (mut stage, mut scene) = failing(CountsJump([0.0, 0.0, -1.5]));
    script(&mut stage, &mut scene, &[(20.0, STATUS, &at(false, 11.0)), (20.0, TO_11, DONE), (20.0, DOWN, DONE)]);
    assert_eq!(scene.axis(Axis::Z, 30.0).0, 11.5);
}

#[test]
fn a_restart_asks_to_be_prepared() {
    let (mut stage, mut scene) = failing(Restart);
    script(
        &mut stage,
        &mut scene,
        &[
            (21.0, STATUS, &at(false, 0.0)),
            (21.0, DOWN, r#"{"error":"the stage isn't prepared","id":3}"#),
            (21.0, PREPARE, r#"{"id":2}"#),
            (40.0, STATUS, &at(false, 12.5)),
        ],
    );
    for bytes in 1..=DOWN.len() as u64 + 1 {
        let (stage, mut scene) = prepared();
        let mut stage = stage.with_faults(&[], &[ProcessStageFaultAfterBytes { bytes, kind: Restart }]);
        ask(&mut stage, &mut scene, 20.0, DOWN);
        assert_eq!(scene.axis(Axis::Z, 30.0).0, 12.5, "{bytes}");
    }
}

#[test]
fn a_stop_is_ignored() {
    let (mut stage, mut scene) = failing(IgnoresStop);
    script(
        &mut stage,
        &mut scene,
        &[(20.0, DOWN, DONE), (20.05, r#"{"do": "stop"}"#, ""), (22.0, STATUS, &at(false, 11.5))],
    );
}

#[test]
fn a_target_is_taken_for_a_distance() {
    let (mut stage, mut scene) = failing(ToIsRelative);
    let to = r#"{"id": 3, "do": "move", "to_mm": {"z": -0.5}, "speed_mm_s": 10}"#;
    script(
        &mut stage,
        &mut scene,
        &[(20.0, to, DONE), (22.0, to, DONE), (24.0, DOWN, DONE), (26.0, STATUS, &at(false, 10.5))],
    );
}

#[test]
fn a_motion_is_never_reported_done() {
    let (mut stage, mut scene) = failing(NeverDone);
    script(&mut stage, &mut scene, &[(20.0, DOWN, DONE), (90.0, STATUS, &at(true, 11.5))]);
}

#[test]
fn another_client_moves_the_axes_and_gets_its_own_answers() {
    let (mut stage, mut scene) = failing(Other(DOWN));
    assert_eq!(stage.owed(&mut scene, 20.0), Owed::Nothing);
    script(&mut stage, &mut scene, &[(20.05, DOWN, r#"{"error":"z moves","id":3}"#), (22.0, STATUS, &at(false, 11.5))]);
}
