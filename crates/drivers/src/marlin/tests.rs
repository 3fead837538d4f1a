//! The Marlin driver against answers from a script.

use super::Marlin;
use crate::script::{scripted, usage};
use palpate_core::quantity::{Axis, Steps};
use palpate_link::device::{MotionOrders, Stage, StageUse};
use std::time::Duration;
use tokio::task::JoinHandle;

const BOOT: (&[u8], &[u8]) = (b"", b"start\nMarlin 2.1.2.4\necho: Last Updated: 2024-01-01\n");
const NUMBERED: (&[u8], &[u8]) = (b"N0 M110 N0*125\n", b"ok\n");
/// The first marker, which is line 1.
const MARKED: (&str, &str) = ("M118 palpate1", "palpate1\nok\n");
/// What identifies it, and what prepares it.
const IDENTIFIED: [(&str, &str); 2] = [
    (
        "M115",
        "FIRMWARE_NAME:Marlin 2.1.2.4 (Jan 1 2024) SOURCE_CODE_URL:github.com PROTOCOL_VERSION:1.0\nCap:EEPROM:1\nok\n",
    ),
    (
        "M503",
        "echo:; Steps per unit:\necho:  M92 X80.00 Y80.00 Z400.00 E93.00\necho:  M203 X500.00 Y500.00 Z10.00 E25.00\necho:  M201 X500.00 Y500.00 Z100.00 E5000.00\nok\n",
    ),
];
const PREPARED: [(&str, &str); 11] = [
    ("M17", "ok\n"),
    ("M84 S0", "ok\n"),
    ("M420 S0", "echo:Bed Leveling OFF\nok\n"),
    ("M155 S0", "ok\n"),
    ("M220 S100", "ok\n"),
    ("G21", "ok\n"),
    ("G90", "ok\n"),
    ("M400", "ok\n"),
    ("M114", AT_ZERO),
    ("M400", "ok\n"),
    ("M114", AT_ZERO),
];
const AT_ZERO: &str = "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\n";

/// Returns the use of a printer that a person brought to its zero.
fn printer() -> StageUse {
    StageUse { by_hand: true, steps: Steps { mm: [0.0125, 0.0125, 0.0025] }, ..usage() }
}

/// Adds number and checksum to the commands of a script, from a line number on.
fn numbered(first: u64, script: &[(&str, &'static str)]) -> Vec<(&'static [u8], &'static [u8])> {
    let line = |(number, (command, answer)): (u64, &(&str, &'static str))| {
        let text = format!("N{number} {command}");
        let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
        (&*Box::leak(format!("{text}*{sum}\n").into_bytes().into_boxed_slice()), answer.as_bytes())
    };
    (first..).zip(script).map(line).collect()
}

/// Returns a printer that has been identified and homed at 0, and answers the rest of the script.
async fn ready(script: &[(&str, &'static str)]) -> (Marlin, JoinHandle<()>) {
    ready_for(&numbered(15, script)).await
}

async fn ready_for(script: &[(&'static [u8], &'static [u8])]) -> (Marlin, JoinHandle<()>) {
    let all = [BOOT, NUMBERED].into_iter().chain(numbered(1, &[&[MARKED][..], &IDENTIFIED, &PREPARED].concat()));
    let (link, device) = scripted(Box::leak(all.chain(script.iter().copied()).collect()));
    let mut stage = Marlin::new(link, "script".to_owned());
    let identity = stage.identify(&printer()).await.unwrap();
    assert_eq!(identity.identity, "Marlin 2.1.2.4");
    stage.home(&printer(), &MotionOrders::default()).await.unwrap();
    (stage, device)
}

async fn moved(stage: &mut Marlin, targets: &[(Axis, f64)]) -> Vec<f64> {
    let orders = MotionOrders::default();
    stage.begin(targets, 2.0, &orders).await.unwrap();
    let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
    stage.follow(&axes, Duration::from_secs(1), &orders).await.unwrap()
}

#[tokio::test(start_paused = true)]
async fn a_motion_is_sent_awaited_and_read_back_by_its_steps() {
    let (mut stage, device) = ready(&[
        ("G1 Z-1.00000 F120.000", "ok\n"),
        ("M400", "echo:busy: processing\necho:busy: processing\nT:21.3 /0.0 B:20.9 /0.0\nok\n"),
        ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-400\nok\n"),
        ("G1 X3.00000 Y4.00000 F150.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:3.00 Y:4.00 Z:-1.00 E:0.00 Count X:240 Y:320 Z:-400\nok\n"),
    ])
    .await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -1.0)]).await, [-1.0]);
    assert_eq!(moved(&mut stage, &[(Axis::X, 3.0), (Axis::Y, 4.0)]).await, [3.0, 4.0]);
    drop(stage);
    device.await.unwrap();
}

/// `usage()` presses toward smaller z.
#[tokio::test(start_paused = true)]
async fn a_short_way_lifts_first_and_ends_toward_the_specimen() {
    let (mut stage, device) = ready(&[
        // one step down: six up, seven down
        ("G1 Z0.01500 F120.000", "ok\n"),
        ("G1 Z-0.00250 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:-1\nok\n"),
        // two steps up: eight up, six down
        ("G1 Z0.01750 F120.000", "ok\n"),
        ("G1 Z0.00250 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:1\nok\n"),
        // no step: no motion
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:1\nok\n"),
        ("G1 X-0.07500 F120.000", "ok\n"),
        ("G1 X0.02500 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.03 Y:0.00 Z:0.00 E:0.00 Count X:2 Y:0 Z:1\nok\n"),
    ])
    .await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -0.0025)]).await, [-0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::Z, 0.0025)]).await, [0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::Z, 0.0025)]).await, [0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::X, 0.025)]).await, [0.025]);
    drop(stage);
    device.await.unwrap();
}

/// After each doubt the port gets in step by a marker, and the command is sent again.
#[tokio::test(start_paused = true)]
async fn a_damaged_line_and_one_without_an_answer_are_sent_again_in_step() {
    let motion = ("G1 Z-1.00000 F120.000", "ok\n");
    let marked = |marker: u64, motion: (&str, &'static str)| {
        let text: &'static str = Box::leak(format!("palpate{marker}\nok\n").into_boxed_str());
        [vec![NUMBERED], numbered(1, &[(&format!("M118 palpate{marker}"), text), motion])].concat()
    };
    let script = [
        numbered(15, &[(motion.0, "Error:checksum mismatch, Last Line: 14\nResend: 15\nok\n")]),
        marked(2, (motion.0, "")), // its `ok` is lost
        marked(3, motion),
        numbered(3, &[("M400", "ok\n"), ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-400\nok\n")]),
    ];
    let (mut stage, device) = ready_for(&script.concat()).await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -1.0)]).await, [-1.0]);
    assert!(stage.complaints().await.unwrap().is_empty());
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_again_after_a_stop() {
    let (mut stage, device) = ready(&[("G1 Z-1.00000 F120.000", "")]).await;
    let orders = MotionOrders::default();
    let begun = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        orders.stop();
    };
    let (begun, ()) = tokio::join!(stage.begin(&[(Axis::Z, -1.0)], 2.0, &orders), begun);
    begun.unwrap();
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_nudge_that_moves_nothing_is_an_error() {
    let (mut stage, device) = ready(&[
        ("G1 Z0.05000 F120.000", "echo:Home XYZ First\nok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\n"),
        // reported once, so that z can still be moved away
        ("M400", "ok\n"),
        ("M114", AT_ZERO),
    ])
    .await;
    let text = stage.nudge_away(1.0, &printer(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("Home XYZ First"), "{text}");
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), 0.0);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_motion_that_is_reported_but_not_made_is_an_error() {
    let (mut stage, device) = ready(&[
        ("G1 Z-1.00000 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-395\nok\n"),
    ])
    .await;
    let orders = MotionOrders::default();
    stage.begin(&[(Axis::Z, -1.0)], 2.0, &orders).await.unwrap();
    let text = stage.follow(&[Axis::Z], Duration::from_secs(1), &orders).await.unwrap_err().to_string();
    assert!(text.contains("it reports z at -1 mm, but its motor is at -0.9875 mm"), "{text}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_restart_loses_the_position_and_nothing_further_is_sent() {
    let (mut stage, device) = ready(&[("G1 Z-1.00000 F120.000", "start\nMarlin 2.1.2.4\n")]).await;
    let orders = MotionOrders::default();
    let text = stage.begin(&[(Axis::Z, -1.0)], 2.0, &orders).await.unwrap_err().to_string();
    assert!(text.contains("it restarted and lost its position"), "{text}");
    assert!(stage.follow(&[Axis::Z], Duration::from_secs(1), &orders).await.is_err());
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn another_step_and_a_search_for_home_are_refused() {
    let script = || {
        let all = [BOOT, NUMBERED].into_iter().chain(numbered(1, &[&[MARKED][..], &IDENTIFIED].concat()));
        scripted(Box::leak(all.collect()))
    };
    let (link, device) = script();
    let mut stage = Marlin::new(link, "script".to_owned());
    let coarse = StageUse { steps: Steps { mm: [0.0125, 0.0125, 0.00125] }, ..printer() };
    let text = stage.identify(&coarse).await.unwrap_err().to_string();
    assert!(text.contains("a step of z is 0.002500 mm by its setting M92, the rig states 0.00125 mm"), "{text}");
    drop(stage);
    device.await.unwrap();
    let (link, device) = script();
    let mut stage = Marlin::new(link, "script".to_owned());
    let fast = StageUse { speed_mm_s: 20.0, ..printer() };
    let text = stage.identify(&fast).await.unwrap_err().to_string();
    assert!(text.contains("its largest speed of z is 10 mm/s by its setting M203"), "{text}");
    drop(stage);
    device.await.unwrap();
    let (mut stage, device) = ready(&[]).await;
    let by_switches = StageUse { by_hand: false, ..printer() };
    let text = stage.home(&by_switches, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("write `home = \"by hand\"` in [stage]"), "{text}");
    drop(stage);
    device.await.unwrap();
}
