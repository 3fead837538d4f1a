//! The GRBL driver against answers from a script.

use super::*;
use crate::device::{Reins, Stage};
use crate::driver::script::{Script, made_ready, scripted, usage};
use crate::quantity::Axis;
use std::time::Duration;
use tokio::task::JoinHandle;

fn stage(script: Script) -> (Grbl, JoinHandle<()>) {
    let (link, device) = scripted(script);
    (Grbl::new(link, "script".to_owned()), device)
}

const SETTINGS: &[u8] = b"$13=0\r\n$22=1\r\n$23=0\r\n$100=800.000\r\n$101=800.000\r\n$102=800.000\r\n$110=1500.000\r\n\
    $111=1500.000\r\n$112=1500.000\r\n$120=100.000\r\n$121=100.000\r\n$122=100.000\r\nok\r\n";

#[tokio::test(start_paused = true)]
async fn a_locked_frame_is_identified_checked_and_homed() {
    let (mut stage, device) = stage(&[
        (b"\x85", b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"),
        (b"$I\n", b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"),
        (b"$$\n", SETTINGS),
        (b"?", b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
        (b"$H\n", b"ok\r\n"),
        (b"?", b"<Idle|MPos:12.000,12.000,12.000|FS:0,0>\r\n"),
        (b"?", b"<Idle|MPos:12.000,12.000,12.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"),
    ]);
    let identity = made_ready(&mut stage, &usage(), &Reins::default()).await.unwrap();
    assert_eq!((identity.identity.as_str(), identity.warnings.len()), ("GRBL 1.1h.20190825", 0));
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn marlin_is_refused_with_the_reason() {
    let (mut stage, device) = stage(&[(b"\x85", b""), (b"$I\n", b"echo:Unknown command: \"$I\"\r\nok\r\n")]);
    let told = made_ready(&mut stage, &usage(), &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("this is Marlin, which can't control a force: it reports where a motion will end"), "{told}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn settings_that_would_be_unsafe_are_refused() {
    for (from, to, told) in [
        ("$13=0", "$13=1", "it reports inches; set $13=0"),
        ("$22=1", "$22=0", "homing is disabled"),
        ("$23=0", "$23=4", "its z homes toward the specimen; set $23"),
        ("$112=1500", "$112=300", "z reaches at most Some(5.0) mm/s; set $112=600"),
        ("$121=100", "$121=10", "y accelerates with Some(10.0) mm/s^2; set $121=100, or the rig's"),
    ] {
        let settings = String::from_utf8_lossy(SETTINGS).replace(from, to).into_bytes();
        let script: Script = Box::leak(Box::new([(b"$$\n".as_slice(), &*Box::leak(settings.into_boxed_slice()))]));
        let (mut stage, device) = stage(script);
        let error = stage.check_settings(&usage()).await.unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
        drop(stage);
        device.await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn a_jog_is_absolute_in_machine_coordinates_and_its_end_is_asked_for() {
    let (mut stage, device) = stage(&[
        (b"$J=G90 G21 G53 Z-1.2500 F90.000\n", b"ok\r\n"),
        (b"?", b"<Jog|MPos:0.000,0.000,-1.200|FS:90,0>\r\n"),
        (b"?", b"<Idle|MPos:0.000,0.000,-1.250|FS:0,0>\r\n"),
    ]);
    stage.usage = Some(usage());
    stage.begin(&[(Axis::Z, -1.25)], 1.5, &Reins::default()).await.unwrap();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(850), &Reins::default()).await.unwrap();
    assert_eq!(places_mm, [-1.25]);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn two_axes_go_at_the_speed_of_the_faster_one() {
    let (mut stage, device) = stage(&[
        (b"?", b"<Idle|MPos:0.000,1.000,0.000|FS:0,0>\r\n"),
        (b"$J=G90 G21 G53 X3.0000 Y5.0000 F750.000\n", b"ok\r\n"),
    ]);
    stage.usage = Some(usage());
    stage.begin(&[(Axis::X, 3.0), (Axis::Y, 5.0)], 10.0, &Reins::default()).await.unwrap();
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_stop_is_one_byte_at_once() {
    let (mut stage, device) = stage(&[(b"\x85", b""), (b"?", b"<Idle|MPos:0.000,0.000,-0.400|FS:0,0>\r\n")]);
    let reins = Reins::default();
    reins.stop();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_secs(5), &reins).await.unwrap();
    assert_eq!(places_mm, [-0.4]);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_refused_jog_an_alarm_and_a_restart_are_told() {
    let (mut refused, device) = stage(&[(b"$J=G90 G21 G53 Z1.0000 F60.000\n", b"error:15\r\n")]);
    refused.usage = Some(usage());
    let told = refused.begin(&[(Axis::Z, 1.0)], 1.0, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("error 15 (the jog exceeds the travel)"), "{told}");
    drop(refused);
    device.await.unwrap();

    let (mut alarmed, device) = stage(&[(b"?", b"ALARM:1\r\n<Alarm|MPos:0.000,0.000,-0.400|FS:0,0>\r\n")]);
    let told = alarmed.follow(&[Axis::Z], Duration::ZERO, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("Alarm") && told.contains("a limit switch was hit; its position is lost"), "{told}");
    drop(alarmed);
    device.await.unwrap();

    let (mut restarted, device) =
        stage(&[(b"?", b"Grbl 1.1h ['$' for help]\r\n<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n")]);
    let told = restarted.position_mm(Axis::Z, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("it restarted and lost its position"), "{told}");
    drop(restarted);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_target_outside_the_travel_is_never_sent() {
    let (mut stage, device) = stage(&[]);
    stage.usage = Some(usage());
    let told = stage.begin(&[(Axis::Z, 12.6)], 1.0, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("z at 12.6 mm is outside the rig's travel"), "{told}");
    drop(stage);
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn a_cancel_that_comes_before_the_jog_is_under_way_is_sent_again_behind_its_ok() {
    let (mut stage, device) =
        stage(&[(b"$J=G90 G21 G53 Z-1.2500 F90.000\n", b""), (b"\x85", b"ok\r\n"), (b"\x85", b"")]);
    stage.usage = Some(usage());
    let reins = Reins::default();
    let ask_for_it = async {
        tokio::time::sleep(Duration::from_millis(130)).await;
        reins.stop();
    };
    let targets = [(Axis::Z, -1.25)];
    let (begun, ()) = tokio::join!(stage.begin(&targets, 1.5, &reins), ask_for_it);
    begun.unwrap();
    drop(stage);
    device.await.unwrap();
}
