//! The GRBL driver against answers from a script.

use super::firmware::{Build, GrblFirmware};
use super::settings::ReportedSettings;
use super::*;
use crate::script::{Script, made_ready, scripted, usage, ways};
use palpate_core::quantity::{Axis, Range, Travel};
use palpate_link::device::{MotionOrders, Stage, StageUse};
use std::time::Duration;
use tokio::task::JoinHandle;

/// The answer of a board that opening its port doesn't reset.
const AWAKE: (&[u8], &[u8]) = (b"?", b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n");

const WELCOME: (&[u8], &[u8]) = (b"", b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n");

fn stage_at(script: Script) -> (Grbl, JoinHandle<()>) {
    let (link, device) = scripted(script);
    (Grbl::new(link, "script".to_owned()), device)
}

/// A stage that is awake when its port is opened.
fn stage(script: Script) -> (Grbl, JoinHandle<()>) {
    stage_at(Box::leak([&[AWAKE], script].concat().into_boxed_slice()))
}

/// The use of a stage with this travel along each axis.
fn usage_of(min_mm: f64, max_mm: f64) -> StageUse {
    StageUse { travel: Travel { axes: [Range { min: min_mm, max: max_mm }; 3] }, ..usage() }
}

const SETTINGS: &[u8] = b"$1=255\r\n$13=0\r\n$20=1\r\n$22=1\r\n$23=0\r\n$27=1.000\r\n$100=800.000\r\n$101=800.000\r\n\
    $102=800.000\r\n$110=1500.000\r\n$111=1500.000\r\n$112=1500.000\r\n$120=100.000\r\n$121=100.000\r\n$122=100.000\r\n\
    $130=25.000\r\n$131=25.000\r\n$132=25.000\r\nok\r\n";

#[tokio::test(start_paused = true)]
async fn a_locked_frame_is_identified_checked_and_homed() {
    let (mut stage, device) = stage_at(&[
        WELCOME,
        (b"\x85", b""),
        (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
        (b"$$\n", SETTINGS),
        (b"?", b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
        (b"$H\n", b"ok\r\n"),
        (b"?", b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"),
        (b"?", b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"),
        (b"?", b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\n"),
    ]);
    let identity = made_ready(&mut stage, &usage_of(-25.0, -1.0), &MotionOrders::default()).await.unwrap();
    assert_eq!((identity.identity.as_str(), identity.warnings.len()), ("GRBL 1.1h.20190825", 0));
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn homing_side_other_than_declared_is_refused() {
    let (mut stage, device) = stage(&[
        (b"\x85", b""),
        (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
        (b"$$\n", SETTINGS),
        (b"?", b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
        (b"$H\n", b"ok\r\n"),
        (b"?", b"<Idle|MPos:12.000,12.000,12.000|FS:0,0>\r\n"),
        (b"?", b"<Idle|MPos:12.000,12.000,12.000|FS:0,0>\r\n"),
    ]);
    let text = made_ready(&mut stage, &usage_of(-25.0, -1.0), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("x counts 12.000 mm after homing, and by its settings should count -1.000 mm"), "{text}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_frame_without_switches_is_taken_as_it_counts() {
    let settings = String::from_utf8_lossy(SETTINGS).replace("$20=1", "$20=0").replace("$22=1", "$22=0").into_bytes();
    let script: Script = Box::leak(Box::new([
        (b"".as_slice(), b"\r\nGrbl 1.1h ['$' for help]\r\n".as_slice()),
        (b"\x85", b""),
        (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
        (b"$$\n", &*Box::leak(settings.into_boxed_slice())),
        (b"?", b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
        (b"?", b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
    ]));
    let (mut stage, device) = stage_at(script);
    let usage = StageUse { by_hand: true, ..usage_of(-40.0, 40.0) };
    let identity = made_ready(&mut stage, &usage, &MotionOrders::default()).await.unwrap();
    assert!(identity.warnings[0].contains("only this program's limits stop it"), "{:?}", identity.warnings);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn marlin_is_refused_with_its_driver() {
    let (mut stage, device) = stage(&[(b"\x85", b""), (b"$I\n", b"echo:Unknown command: \"$I\"\r\nok\r\n")]);
    let text = made_ready(&mut stage, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("this is Marlin: write `driver = \"marlin\"` in [stage]"), "{text}");
    drop(stage);
    device.await.unwrap();
}

fn stock() -> Build {
    Build { firmware: GrblFirmware::Grbl, version: "1.1h".to_owned(), sets_origin: false }
}

#[tokio::test(start_paused = true)]
async fn settings_that_would_be_unsafe_are_refused() {
    for (from, to, text) in [
        ("$1=255", "$1=25", "its motors are off 25 ms after each motion, and the axes can slip; send $1=255"),
        ("$1=255\r\n", "", "it doesn't report the idle delay of its motors ($1)"),
        ("$13=0", "$13=1", "it reports inches; send $13=0"),
        ("$20=1", "$20=0", "its soft limits are off; send $20=1"),
        ("$22=1", "$22=0", "homing is disabled, so its position is unknown; send $22=1, or write `home = \"by hand\"`"),
        ("$23=0", "$23=4", "its z homes toward the specimen ($23=4); send $23=0"),
        (
            "$27=1.000",
            "$27=3.000",
            "x counts from -25.000 to -3.000 mm ($130=25.000, home at -3.000), but `travel_mm.x`",
        ),
        (
            "$27=1.000",
            "$27=0.500",
            "x is at -0.500 mm after homing ($27=0.500), but `travel_mm.x` goes from -25 to -1 mm",
        ),
        ("$132=25", "$132=20", "z counts from -20.000 to -1.000 mm ($132=20.000, home at -1.000), but `travel_mm.z`"),
        ("$112=1500", "$112=300", "z reaches at most 5.00 mm/s; send $112=600"),
        ("$121=100", "$121=10", "y accelerates with 10 mm/s^2; send $121=100, or lower the rig's"),
    ] {
        let settings = String::from_utf8_lossy(SETTINGS).replace(from, to).into_bytes();
        let script: Script = Box::leak(Box::new([(b"$$\n".as_slice(), &*Box::leak(settings.into_boxed_slice()))]));
        let (mut stage, device) = stage(script);
        let error = stage.check_settings(&stock(), &usage_of(-25.0, -1.0)).await.unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
        drop(stage);
        device.await.unwrap();
    }
}

/// GRBL refuses soft limits (`$20`) where it has no search for home (`$22`).
#[test]
fn all_settings_are_named_at_once_in_the_order_in_which_it_takes_them() {
    let numbers = String::from_utf8_lossy(SETTINGS).replace("$1=255", "$1=25").replace("$20=1", "$20=0");
    let numbers = numbers.replace("$22=1", "$22=0").replace("$121=100", "$121=10");
    let pairs = numbers.lines().filter_map(|line| line.trim().strip_prefix('$')?.split_once('='));
    let values = pairs.map(|(n, value)| (n.parse().unwrap(), value.parse().unwrap())).collect();
    let texts = ReportedSettings::new(values, &[]).check(&stock(), &usage_of(-25.0, -1.0)).unwrap_err();
    let lines: Vec<&str> = texts.iter().filter_map(|text| text.split("send ").nth(1)).collect();
    let sent: Vec<&str> = lines.iter().filter_map(|line| line.split([',', ' ']).next()).collect();
    assert_eq!(sent, ["$1=255", "$22=1", "$20=1", "$121=100"], "{texts:?}");
}

#[tokio::test(start_paused = true)]
async fn axis_coordinate_depends_on_switch_and_build() {
    let settings = |mask| {
        let numbers = String::from_utf8_lossy(SETTINGS).replace("$23=0", &format!("$23={mask}"));
        let pairs = numbers.lines().filter_map(|line| line.strip_prefix('$')?.split_once('='));
        ReportedSettings::new(pairs.map(|(n, value)| (n.parse().unwrap(), value.parse().unwrap())).collect(), &[])
    };
    let origin = Build { sets_origin: true, ..stock() };
    for (mask, build, min_mm, max_mm, home_mm) in [
        (0, stock(), -25.0, -1.0, [-1.0; 3]),
        (3, stock(), -24.0, -1.0, [-24.0, -24.0, -1.0]),
        (0, origin.clone(), -25.0, 0.0, [0.0; 3]),
    ] {
        let usage = usage_of(min_mm, max_mm);
        assert_eq!(settings(mask).check(&build, &usage).unwrap().home_mm, Some(home_mm));
        assert!(settings(mask).check(&build, &usage_of(min_mm - 0.1, max_mm)).is_err());
        assert!(settings(mask).check(&build, &usage_of(min_mm, max_mm + 0.1)).is_err());
    }
    let up = StageUse { away: -1.0, ..usage_of(0.0, 25.0) };
    assert_eq!(settings(7).check(&origin, &up).unwrap().home_mm, Some([0.0; 3]));
}

#[tokio::test(start_paused = true)]
async fn fluidnc_is_asked_by_name_for_what_it_has_no_number_for() {
    let settings = String::from_utf8_lossy(SETTINGS);
    let settings =
        ["$1=255\r\n", "$13=0\r\n", "$27=1.000\r\n"].iter().fold(settings.into_owned(), |s, line| s.replace(line, ""));
    let script: Script = Box::leak(Box::new([
        (b"$$\n".as_slice(), &*Box::leak(settings.into_bytes().into_boxed_slice())),
        (b"$/stepping/idle_ms\n", b"$/stepping/idle_ms=255\r\nok\r\n"),
        (b"$/report_inches\n", b"$/report_inches=false\r\nok\r\n"),
    ]));
    let (mut stage, device) = stage(script);
    let build =
        Build { firmware: GrblFirmware::FluidNc, version: "3.7 FluidNC v3.7.16".to_owned(), sets_origin: false };
    assert_eq!(stage.check_settings(&build, &usage_of(-25.0, -1.0)).await.unwrap(), Vec::<String>::new());
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_jog_is_a_displacement_and_its_end_is_asked_for() {
    let (mut stage, device) = stage(&[
        (b"$J=G91 G21 Z-1.25000 F90.000\n", b"ok\r\n"),
        (b"?", b"<Jog|MPos:0.000,0.000,-1.200|FS:90,0>\r\n"),
        (b"?", b"<Idle|MPos:0.000,0.000,-1.250|FS:0,0>\r\n"),
    ]);
    stage.usage = Some(usage());
    stage.begin(&ways(&[(Axis::Z, -1.25)]), 1.5, &MotionOrders::default()).await.unwrap();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(850), &MotionOrders::default()).await.unwrap();
    assert_eq!(places_mm, [-1.25]);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn two_axes_go_at_the_speed_of_the_faster_one() {
    let (mut stage, device) = stage(&[(b"$J=G91 G21 X3.00000 Y4.00000 F750.000\n", b"ok\r\n")]);
    stage.usage = Some(usage());
    stage.begin(&ways(&[(Axis::X, 3.0), (Axis::Y, 4.0)]), 10.0, &MotionOrders::default()).await.unwrap();
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_stop_is_one_byte_at_once() {
    let (mut stage, device) = stage_at(&[(b"\x85", b""), (b"?", b"<Idle|MPos:0.000,0.000,-0.400|FS:0,0>\r\n")]);
    let orders = MotionOrders::default();
    orders.stop();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_secs(5), &orders).await.unwrap();
    assert_eq!(places_mm, [-0.4]);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_refused_jog_an_alarm_and_a_restart_are_reported() {
    let (mut refused, device) = stage(&[(b"$J=G91 G21 Z1.00000 F60.000\n", b"error:15\r\n")]);
    refused.usage = Some(usage());
    let text = refused.begin(&ways(&[(Axis::Z, 1.0)]), 1.0, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("error 15 (the jog exceeds the travel)"), "{text}");
    drop(refused);
    device.await.unwrap();

    let (mut alarmed, device) = stage(&[(b"?", b"ALARM:1\r\n<Alarm|MPos:0.000,0.000,-0.400|FS:0,0>\r\n")]);
    let text = alarmed.follow(&[Axis::Z], Duration::ZERO, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("Alarm") && text.contains("a limit switch was hit; its position is lost"), "{text}");
    drop(alarmed);
    device.await.unwrap();

    let (mut restarted, device) =
        stage(&[(b"?", b"Grbl 1.1h ['$' for help]\r\n<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n")]);
    let text = restarted.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("it restarted and lost its position"), "{text}");
    drop(restarted);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_target_outside_the_travel_is_never_sent() {
    let (mut stage, device) = stage(&[]);
    stage.usage = Some(usage());
    let text = stage.begin(&ways(&[(Axis::Z, -12.6)]), 1.0, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("z at -12.6 mm is outside the rig's travel"), "{text}");
    drop(stage);
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn a_cancel_that_comes_before_the_jog_is_under_way_is_sent_again_behind_its_ok() {
    let (mut stage, device) = stage(&[(b"$J=G91 G21 Z-1.25000 F90.000\n", b""), (b"\x85", b"ok\r\n"), (b"\x85", b"")]);
    stage.usage = Some(usage());
    let orders = MotionOrders::default();
    let ask_for_it = async {
        palpate_link::time::sleep(Duration::from_millis(2730)).await;
        orders.stop();
    };
    let targets = ways(&[(Axis::Z, -1.25)]);
    let (begun, ()) = tokio::join!(stage.begin(&targets, 1.5, &orders), ask_for_it);
    begun.unwrap();
    drop(stage);
    device.await.unwrap();
}
