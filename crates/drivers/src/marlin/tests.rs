//! The Marlin driver against answers from a script.

use super::Marlin;
use crate::script::{scripted, usage, ways};
use palpate_core::quantity::{Axis, Steps};
use palpate_link::device::{AxisWay, MotionOrders, Stage, StageUse};
use std::time::Duration;
use tokio::task::JoinHandle;

const BOOT: (&[u8], &[u8]) = (b"", b"start\nMarlin 2.1.2.4\necho: Last Updated: 2024-01-01\n");
/// The first marker, which is line 1002.
const MARKED: (&str, &str) = ("M118 palpate1", "palpate1\nok\n");
/// What identifies it, and what prepares it.
const IDENTIFIED: [(&str, &str); 2] = [
    (
        "M115",
        "FIRMWARE_NAME:Maker Marlin 2.1.2.4 (Jan 1 2024) SOURCE_CODE_URL:github.com PROTOCOL_VERSION:1.0\nCap:EEPROM:1\nok\n",
    ),
    (
        "M503",
        "echo:; Steps per unit:\necho:  M92 X80.00 Y80.00 Z400.00 E93.00\necho:  M203 X500.00 Y500.00 Z10.00 E25.00\necho:  M201 X500.00 Y500.00 Z100.00 E5000.00\nok\n",
    ),
];
const PREPARED: [(&str, &str); 12] = [
    ("M17", "ok\n"),
    ("M84 S0", "ok\n"),
    ("M420 S0", "echo:Bed Leveling OFF\nok\n"),
    ("M155 S0", "ok\n"),
    ("M220 S100", "ok\n"),
    ("G20", "echo:Unknown command: \"G20\"\nok\n"),
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
    StageUse { by_hand: true, steps: Steps { mm: [0.0125, 0.0125, 0.0025], ..Steps::FINE }, ..usage() }
}

/// Sets the number of the next line.
fn numbering(number: u64) -> Vec<(&'static [u8], &'static [u8])> {
    numbered(number, &[(&format!("M110 N{number}"), "ok\n")])
}

/// What comes before each motion: zero where the axes count this.
fn zeroed(count: &'static str) -> [(&'static str, &'static str); 1] {
    let answer = format!("X:0.00 Y:0.00 Z:0.00 E:0.00 Count {count}\nok\n");
    [("G92 X0 Y0 Z0", Box::leak(answer.into_boxed_str()))]
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

/// Number of the first line after that.
const FIRST: u64 = 1017;

/// Returns a printer that has been identified and homed at 0, and answers the rest of the script.
async fn ready(script: &[(&str, &'static str)]) -> (Marlin, JoinHandle<()>) {
    ready_for(&numbered(FIRST, script)).await
}

async fn ready_for(script: &[(&'static [u8], &'static [u8])]) -> (Marlin, JoinHandle<()>) {
    let all = [BOOT].into_iter().chain(numbering(1001));
    let all = all.chain(numbered(1002, &[&[MARKED][..], &IDENTIFIED, &PREPARED].concat()));
    let (link, device) = scripted(Box::leak(all.chain(script.iter().copied()).collect()));
    let mut stage = Marlin::new(link, "script".to_owned());
    let identity = stage.identify(&printer()).await.unwrap();
    assert_eq!(identity.identity, "Maker Marlin 2.1.2.4");
    stage.home(&printer(), &MotionOrders::default()).await.unwrap();
    (stage, device)
}

async fn moved(stage: &mut Marlin, targets: &[(Axis, f64)]) -> Vec<f64> {
    let orders = MotionOrders::default();
    let from_mm: [f64; 3] = std::array::from_fn(|axis| stage.at[axis] as f64 / stage.steps_per_mm[axis]);
    let way = |(axis, to_mm): &(Axis, f64)| AxisWay::between(*axis, from_mm[axis.index()], *to_mm);
    let ways: Vec<AxisWay> = targets.iter().map(way).collect();
    stage.begin(&ways, 2.0, &orders).await.unwrap();
    let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
    stage.follow(&axes, Duration::from_secs(1), &orders).await.unwrap()
}

#[tokio::test(start_paused = true)]
async fn a_motion_is_a_displacement_and_is_read_back_by_its_steps() {
    let down = [
        ("G1 Z-1.00000 F120.000", "ok\n"),
        ("M400", "echo:busy: processing\necho:busy: processing\nT:21.3 /0.0 B:20.9 /0.0\nok\n"),
        ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-400\nok\n"),
    ];
    let sideways = [
        ("G1 X3.00000 Y4.00000 F150.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:3.00 Y:4.00 Z:0.00 E:0.00 Count X:240 Y:320 Z:-400\nok\n"),
    ];
    let script = [&zeroed("X:0 Y:0 Z:0")[..], &down, &zeroed("X:0 Y:0 Z:-400"), &sideways].concat();
    let (mut stage, device) = ready(&script).await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -1.0)]).await, [-1.0]);
    assert_eq!(moved(&mut stage, &[(Axis::X, 3.0), (Axis::Y, 4.0)]).await, [3.0, 4.0]);
    drop(stage);
    device.await.unwrap();
}

/// `usage()` presses toward smaller z.
#[tokio::test(start_paused = true)]
async fn a_short_way_lifts_first_and_ends_toward_the_specimen() {
    let motion = |before: &'static str, lines: [&'static str; 2], end: &'static str| {
        [&zeroed(before)[..], &lines.map(|line| (line, "ok\n")), &[("M400", "ok\n"), ("M114", end)]].concat()
    };
    let script = [
        // one step down: six up, seven down
        motion(
            "X:0 Y:0 Z:0",
            ["G1 Z0.01500 F120.000", "G1 Z-0.00250 F120.000"],
            "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:-1\nok\n",
        ),
        // two steps up: eight up, six down
        motion(
            "X:0 Y:0 Z:-1",
            ["G1 Z0.02000 F120.000", "G1 Z0.00500 F120.000"],
            "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:1\nok\n",
        ),
        // no step: no motion
        vec![("M400", "ok\n"), ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:1\nok\n")],
        motion(
            "X:0 Y:0 Z:1",
            ["G1 X-0.07500 F120.000", "G1 X0.02500 F120.000"],
            "X:0.03 Y:0.00 Z:0.00 E:0.00 Count X:2 Y:0 Z:1\nok\n",
        ),
    ];
    let (mut stage, device) = ready(&script.concat()).await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -0.0025)]).await, [-0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::Z, 0.0025)]).await, [0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::Z, 0.0025)]).await, [0.0025]);
    assert_eq!(moved(&mut stage, &[(Axis::X, 0.025)]).await, [0.025]);
    drop(stage);
    device.await.unwrap();
}

/// A line is only sent again with its number, so the printer takes it once.
#[tokio::test(start_paused = true)]
async fn a_damaged_line_and_one_without_an_answer_are_sent_again_with_their_number() {
    let motion = "G1 Z-1.00000 F120.000";
    let (first, after) = (FIRST + 1, FIRST + 2);
    let damaged = format!("Error:checksum mismatch, Last Line: {}\nResend: {first}\nok\n", first - 1);
    let had = format!("Error:Line Number is not Last Line Number+1, Last Line: {first}\nResend: {after}\nok\n");
    let [damaged, had] = [damaged, had].map(|text| -> &'static str { Box::leak(text.into_boxed_str()) });
    let ends = [("M400", "ok\n"), ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-400\nok\n")];
    let script = [
        numbered(FIRST, &zeroed("X:0 Y:0 Z:0")),
        numbered(first, &[(motion, damaged)]),
        numbered(first, &[(motion, "")]), // its `ok` is lost
        numbered(first, &[(motion, had)]),
        numbered(after, &ends),
    ];
    let (mut stage, device) = ready_for(&script.concat()).await;
    assert_eq!(moved(&mut stage, &[(Axis::Z, -1.0)]).await, [-1.0]);
    assert!(stage.complaints().await.unwrap().is_empty());
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_again_after_a_stop() {
    let script = [&zeroed("X:0 Y:0 Z:0")[..], &[("G1 Z-1.00000 F120.000", "")]].concat();
    let (mut stage, device) = ready(&script).await;
    let orders = MotionOrders::default();
    let begun = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        orders.stop();
    };
    let way = ways(&[(Axis::Z, -1.0)]);
    let (begun, ()) = tokio::join!(stage.begin(&way, 2.0, &orders), begun);
    begun.unwrap();
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_nudge_that_moves_nothing_is_an_error() {
    let refused = [
        ("G1 Z0.05000 F120.000", "echo:Home XYZ First\nok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\n"),
        // reported once, so that z can still be moved away
        ("M400", "ok\n"),
        ("M114", AT_ZERO),
    ];
    let (mut stage, device) = ready(&[&zeroed("X:0 Y:0 Z:0")[..], &refused].concat()).await;
    let text = stage.nudge_away(1.0, &printer(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("Home XYZ First"), "{text}");
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), 0.0);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_motion_that_is_reported_but_not_made_is_an_error() {
    let short = [
        ("G1 Z-1.00000 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:-1.00 E:0.00 Count X:0 Y:0 Z:-395\nok\n"),
    ];
    let (mut stage, device) = ready(&[&zeroed("X:0 Y:0 Z:0")[..], &short].concat()).await;
    let orders = MotionOrders::default();
    stage.begin(&ways(&[(Axis::Z, -1.0)]), 2.0, &orders).await.unwrap();
    let text = stage.follow(&[Axis::Z], Duration::from_secs(1), &orders).await.unwrap_err().to_string();
    assert!(text.contains("it reports z at -1 mm, but its motor is at -0.9875 mm"), "{text}");
    drop(stage);
    device.await.unwrap();
}

/// What a board sends when a line comes after its restart: it counts lines from 0.
const REFUSED: &str = "Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n";

/// Each form of a restart loses the place, is stated once, and leaves the way out open.
#[tokio::test(start_paused = true)]
async fn after_a_restart_nothing_moves_but_away() {
    for announced in [
        "start\n",
        "echo:start\n",
        "\u{fffd}\u{fffd}start\n",
        "stZrt\n",
        "ok T:start\n",
        "start\necho: Free Memory: 3400\n",
        "",
    ] {
        let answer: &'static str = Box::leak(format!("{announced}{REFUSED}").into_boxed_str());
        let again = FIRST + 1;
        let away = [
            ("G1 Z1.00000 F120.000", "ok\n"),
            ("M400", "ok\n"),
            ("M114", "X:0.00 Y:0.00 Z:1.00 E:0.00 Count X:0 Y:0 Z:400\nok\n"),
        ];
        let script = [
            numbered(FIRST, &[("G92 X0 Y0 Z0", answer)]),
            numbering(again),
            numbered(again + 1, &[&[("M118 palpate2", "palpate2\nok\n")], &zeroed("X:0 Y:0 Z:0")[..], &away].concat()),
        ];
        let (mut stage, device) = ready_for(&script.concat()).await;
        let orders = MotionOrders::default();
        let text = stage.begin(&ways(&[(Axis::Z, -1.0)]), 2.0, &orders).await.unwrap_err().to_string();
        assert!(text.contains("it restarted and lost its position"), "{announced}: {text}");
        let text = stage.begin(&ways(&[(Axis::Z, -1.0)]), 2.0, &orders).await.unwrap_err().to_string();
        assert!(text.contains("it restarted and lost its position"), "{announced}: {text}");
        assert_eq!(moved(&mut stage, &[(Axis::Z, 1.0)]).await, [1.0], "{announced}");
        drop(stage);
        device.await.unwrap();
    }
}

/// The board restarted while the tip rested: what came in meanwhile is read before a motion.
#[tokio::test(start_paused = true)]
async fn a_restart_that_was_announced_at_rest_is_read_before_a_motion() {
    let at_rest = [("M114", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\nok\necho:start\n")];
    let (mut stage, device) = ready(&[&[("M400", "ok\n")][..], &at_rest].concat()).await;
    let orders = MotionOrders::default();
    stage.position_mm(Axis::Z, &orders).await.unwrap();
    let text = stage.begin(&ways(&[(Axis::Z, -1.0)]), 2.0, &orders).await.unwrap_err().to_string();
    assert!(text.contains("it restarted and lost its position"), "{text}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn an_answer_too_many_and_a_damaged_position_are_put_right() {
    let damaged = "X:0.00 Y:0.00 Z:0.x0 E:0.00 Count X:0 Y:0 Z:0\nok\n";
    let marked = ("M118 palpate2", "palpate2\nok\n");
    let script = [numbered(FIRST, &[("M400", "ok\nok\n"), ("M114", damaged), marked, ("M114", AT_ZERO)])];
    let (mut stage, device) = ready_for(&script.concat()).await;
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), 0.0);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_count_that_changed_at_rest_stops_a_motion_but_not_the_way_out() {
    let away = [
        ("G1 Z1.00000 F120.000", "ok\n"),
        ("M400", "ok\n"),
        ("M114", "X:0.00 Y:0.00 Z:1.00 E:0.00 Count X:0 Y:0 Z:360\nok\n"),
    ];
    let script = [&zeroed("X:0 Y:0 Z:-40")[..], &zeroed("X:0 Y:0 Z:-40"), &away].concat();
    let (mut stage, device) = ready(&script).await;
    let orders = MotionOrders::default();
    let text = stage.begin(&ways(&[(Axis::Z, -1.0)]), 2.0, &orders).await.unwrap_err().to_string();
    assert!(text.contains("its count of z changed while it rested: something else moved it"), "{text}");
    assert_eq!(moved(&mut stage, &[(Axis::Z, 1.0)]).await, [1.0]);
    drop(stage);
    device.await.unwrap();
}

/// A printer that says `busy` without end is given up in a bounded time.
#[tokio::test(start_paused = true)]
async fn busy_without_end_is_given_up() {
    let busy: &'static str = Box::leak("echo:busy: processing\n".repeat(100_000).into_boxed_str());
    let (mut stage, device) = ready(&[("M400", busy)]).await;
    let began = tokio::time::Instant::now();
    assert!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.is_err());
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    drop(stage);
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn another_step_and_a_search_for_home_are_refused() {
    let script = || {
        let all = [BOOT].into_iter().chain(numbering(1001));
        scripted(Box::leak(all.chain(numbered(1002, &[&[MARKED][..], &IDENTIFIED].concat())).collect()))
    };
    let (link, device) = script();
    let mut stage = Marlin::new(link, "script".to_owned());
    let coarse = StageUse { steps: Steps { mm: [0.0125, 0.0125, 0.00125], ..Steps::FINE }, ..printer() };
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
    // all at once
    let (link, device) = script();
    let mut stage = Marlin::new(link, "script".to_owned());
    let text = stage.identify(&StageUse { steps: coarse.steps, ..fast }).await.unwrap_err().to_string();
    let both = "2 settings differ from the rig:\n  - a step of z is 0.002500 mm by its setting M92, the rig states 0.00125 mm; write \
                `step_mm.z = 0.002500` in [stage] if the printer is set correctly\n  - its largest speed of z is 10 mm/s by its setting M203, \
                the rig's `speed_mm_s` is 20";
    assert!(text.ends_with(both), "{text}");
    drop(stage);
    device.await.unwrap();
    let (mut stage, device) = ready(&[]).await;
    let by_switches = StageUse { by_hand: false, ..printer() };
    let text = stage.home(&by_switches, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("write `home = \"by hand\"` in [stage]"), "{text}");
    drop(stage);
    device.await.unwrap();
}
