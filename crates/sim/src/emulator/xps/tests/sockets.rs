//! Tests of the XPS over several sockets.

use super::*;
use crate::emulator::tests::{Wire, shared};
use palpate_link::time::{Instant, sleep};
use std::time::Duration;

/// Sends a text on one socket, and reads exactly the expected answer.
async fn exchange(wire: &mut Wire, sent: &str, answered: &str) {
    let reply = wire.ask(sent.as_bytes(), answered.len()).await;
    assert_eq!(String::from_utf8_lossy(&reply), answered, "to {sent}");
}

/// Returns a homed controller on the wire: its scene and three sockets.
async fn wired() -> (Shared<Scene>, [Wire; 3], Shared<XpsEmulator>) {
    wired_on(scene()).await
}

async fn wired_on(scene: Scene) -> (Shared<Scene>, [Wire; 3], Shared<XpsEmulator>) {
    let xps = shared(xps(&scene));
    let (scene, origin) = (shared(scene), Instant::now());
    let mut wires = [0; 3].map(|_| Wire::to(xps.clone(), scene.clone(), origin));
    exchange(&mut wires[0], "GroupInitialize(XYZ)", "0,,EndOfAPI").await;
    exchange(&mut wires[0], "GroupHomeSearch(XYZ)", "0,,EndOfAPI").await;
    (scene, wires, xps)
}

#[tokio::test(start_paused = true)]
async fn move_blocks_only_its_socket_and_an_abort_on_another_ends_it() {
    let (_, [mut moves, mut polls, mut aborts], _) = wired().await;
    exchange(&mut moves, "PositionerSGammaParametersSet(XYZ.X,1,100,0.005,0.05)", "0,,EndOfAPI").await;
    let begun = Instant::now();
    moves.send(b"GroupMoveAbsolute(XYZ, 5, 0, 0)").await;
    sleep(Duration::from_millis(500)).await;
    exchange(&mut polls, "GroupStatusGet(XYZ,int *)", "0,44,EndOfAPI").await;
    exchange(&mut moves, "GroupStatusGet(XYZ,int *)", "-1,GroupStatusGet(XYZ,int *),EndOfAPI").await;
    exchange(&mut aborts, "GroupMoveAbort(XYZ)", "0,,EndOfAPI").await;
    exchange(&mut moves, "", "-27,GroupMoveAbsolute(XYZ, 5, 0, 0),EndOfAPI").await;
    assert!(begun.elapsed() < Duration::from_millis(520), "{:?}", begun.elapsed());
    exchange(&mut polls, "GroupStatusGet(XYZ,int *)", "0,10,EndOfAPI").await;
    exchange(&mut moves, "GroupMoveAbsolute(XYZ,0,0,0)", "0,,EndOfAPI").await;
    for wire in [&mut moves, &mut polls, &mut aborts] {
        assert!(wire.is_silent().await);
    }
}

/// Guard that aborts above 3 V, which is 1.5 N or 0.75 mm.
const GUARD: [(&str, &str); 3] = [
    (
        "EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,3.0,0,0,0,XYZ.SGamma.MotionState,0,0,0,0)",
        "0,,EndOfAPI",
    ),
    ("EventExtendedConfigurationActionSet(XYZ.MoveAbort,0,0,0,0)", "0,,EndOfAPI"),
    ("EventExtendedStart(int *)", "0,1,EndOfAPI"),
];

const SLOW_Z: &str = "PositionerSGammaParametersSet(XYZ.Z,1,100,0.005,0.05)";

#[tokio::test(start_paused = true)]
async fn guard_aborts_a_press_within_a_millisecond_and_is_removed() {
    let (scene, [mut moves, mut polls, _], _) = wired().await;
    exchange(&mut polls, SLOW_Z, "0,,EndOfAPI").await;
    for (sent, answered) in GUARD {
        exchange(&mut polls, sent, answered).await;
    }
    exchange(&mut moves, "GroupMoveAbsolute(XYZ,0,0,-3)", "-27,GroupMoveAbsolute(XYZ,0,0,-3),EndOfAPI").await;
    exchange(&mut polls, "GroupStatusGet(XYZ,int *)", "0,10,EndOfAPI").await;
    let force_n = scene.lock().expect("sound").true_force_n(1000.0);
    // 1 mm/s for 2 ms, and 5 um to brake
    assert!((1.5..1.5 + 0.008 * STIFFNESS_N_MM).contains(&force_n), "{force_n} N");
    exchange(&mut polls, "EventExtendedRemove(1)", "-83,EventExtendedRemove(1),EndOfAPI").await;
    exchange(&mut moves, "GroupMoveAbsolute(XYZ,0,0,-1)", "0,,EndOfAPI").await;
}

#[tokio::test(start_paused = true)]
async fn guard_can_be_armed_during_a_move_and_removed() {
    let (scene, [mut moves, mut polls, _], _) = wired().await;
    exchange(&mut polls, SLOW_Z, "0,,EndOfAPI").await;
    moves.send(b"GroupMoveAbsolute(XYZ.Z,-3)").await;
    sleep(Duration::from_millis(100)).await;
    for (sent, answered) in GUARD {
        exchange(&mut polls, sent, answered).await;
    }
    exchange(&mut moves, "", "-27,GroupMoveAbsolute(XYZ.Z,-3),EndOfAPI").await;
    let force_n = scene.lock().expect("sound").true_force_n(1000.0);
    assert!((1.5..1.52).contains(&force_n), "{force_n} N");
    // over the limit it can't move at all while it is guarded
    exchange(&mut polls, "EventExtendedStart(int *)", "0,2,EndOfAPI").await;
    exchange(&mut moves, "GroupMoveAbsolute(XYZ.Z,0)", "-27,GroupMoveAbsolute(XYZ.Z,0),EndOfAPI").await;
    exchange(&mut polls, "EventExtendedStart(int *)", "0,3,EndOfAPI").await;
    exchange(&mut polls, "EventExtendedRemove(3)", "0,,EndOfAPI").await;
    exchange(&mut moves, "GroupMoveAbsolute(XYZ.Z,0)", "0,,EndOfAPI").await;
}

#[tokio::test(start_paused = true)]
async fn motion_of_a_closed_socket_continues_under_its_guard() {
    let (scene, [mut moves, mut polls, mut other], xps) = wired().await;
    exchange(&mut polls, SLOW_Z, "0,,EndOfAPI").await;
    for (sent, answered) in GUARD {
        exchange(&mut polls, sent, answered).await;
    }
    moves.send(b"GroupMoveAbsolute(XYZ,1,0,-3)").await;
    sleep(Duration::from_millis(100)).await;
    drop(moves);
    sleep(Duration::from_secs(10)).await;
    assert!(xps.lock().expect("sound").controller().is_unattended());
    exchange(&mut other, "GroupStatusGet(XYZ,int *)", "0,10,EndOfAPI").await;
    let force_n = scene.lock().expect("sound").true_force_n(1000.0);
    assert!((1.5..1.52).contains(&force_n), "{force_n} N");
}

#[tokio::test(start_paused = true)]
async fn armed_guard_has_no_effect_at_rest() {
    let (_, [_, mut polls, _], xps) = wired().await;
    for (sent, answered) in GUARD {
        exchange(&mut polls, sent, answered).await;
    }
    let mut scene = scene();
    assert_eq!(xps.lock().expect("sound").owed(&mut scene, 100.0), Owed::Nothing);
}

#[tokio::test(start_paused = true)]
async fn guard_continues_during_a_slow_exchange() {
    let (scene, [mut moves, mut polls, _], _) = wired_on(scene_with(|spec| spec.latencies.stage_s = (0.7, 0.7))).await;
    exchange(&mut polls, SLOW_Z, "0,,EndOfAPI").await;
    for (sent, answered) in GUARD {
        exchange(&mut polls, sent, answered).await;
    }
    moves.send(b"GroupMoveAbsolute(XYZ,0,0,-3)").await;
    sleep(Duration::from_secs(1)).await;
    // the move began 0.7 s after it was sent, and ends within 0.8 s: before this is acted on
    exchange(&mut moves, "GroupStatusGet(XYZ,int *)", "-27,GroupMoveAbsolute(XYZ,0,0,-3),EndOfAPI").await;
    exchange(&mut moves, "", "0,10,EndOfAPI").await;
    let force_n = scene.lock().expect("sound").true_force_n(1000.0);
    assert!((1.5..1.52).contains(&force_n), "{force_n} N");
}

#[tokio::test(start_paused = true)]
async fn garbage_is_reported_and_the_next_call_answered() {
    let (_, [mut wire, ..], _) = wired().await;
    wire.send(&[b'x'; 5000]).await;
    // four inboxes full, and the rest of the fifth ends with the line
    for _ in 0..4 {
        let reply = wire.ask(b"", 1024).await;
        assert!(reply.starts_with(b"-3,xxx") && reply.ends_with(b"x,EndOfAPI"));
    }
    let left = 5000 - 4 * 1024;
    let reply = wire.ask(b"\r\n", left + 12).await;
    assert!(reply.starts_with(b"-7,xxx"));
    exchange(&mut wire, "GroupStatusGet(XYZ,int *)", "0,11,EndOfAPI").await;
}
