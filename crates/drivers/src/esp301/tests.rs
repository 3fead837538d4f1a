//! The ESP301 driver against answers from a script.

use super::*;
use crate::script::{Script, made_ready, scripted, usage, ways};
use palpate_link::time::sleep;
use tokio::task::JoinHandle;

/// A driver whose far end follows a script.
fn stage(script: Script) -> (Esp301, JoinHandle<()>) {
    let (link, device) = scripted(script);
    (Esp301::new(link, "script".to_owned()), device)
}

#[tokio::test(start_paused = true)]
async fn z_homes_first_and_an_axis_declared_as_homed_stays() {
    let (mut stage, device) = stage(&[
        (b"VE?\r", b"ESP301 Version 1.1.1 16/01/14\r\n"),
        (b"ST\r", b""),
        (
            b"1MD?;2MD?;3MD?;1TP;2TP;3TP;TB?\r",
            b"1\r\n1\r\n1\r\n0.0000\r\n0.0000\r\n0.0000\r\n0, 11, NO ERROR DETECTED\r\n",
        ),
        (b"TB?\r", b"104, 2141749940, AXIS-1 POSITIVE HARDWARE LIMIT DETECTED\r\n"),
        (b"TB?\r", b"0, -2139482948, NO ERROR DETECTED\r\n"),
        (b"1ID?\r", b"VP-25XL, SN1\r\n"),
        (b"1SN?\r", b"2\r\n"),
        (b"1VU?\r", b"25\r\n"),
        (b"2ID?\r", b"VP-25XL, SN2\r\n"),
        (b"2SN?\r", b"2\r\n"),
        (b"2VU?\r", b"25\r\n"),
        (b"3ID?\r", b"VP-25XL, SN3\r\n"),
        (b"3SN?\r", b"2\r\n"),
        (b"3VU?\r", b"25\r\n"),
        (b"1AC100;1AG100;2AC100;2AG100;3AC100;3AG100\r", b""),
        (b"3MO?\r", b"0\r\n"),
        (b"3MO\r", b""),
        (b"3OH2.0000;3SH12.5000;3OR3\r", b""),
        (b"3MD?;3TP;TB?\r", b"0\r\n11.9000\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"3MD?;3TP;TB?\r", b"1\r\n12.5000\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"TB?\r", b"0, 11, NO ERROR DETECTED\r\n"),
        (b"3TP\r", b"12.5000\r\n"),
        (b"1MO?\r", b"1\r\n"),
        (b"2MO?\r", b"1\r\n"),
        (b"1SL-12.5000;1SR12.5000\r", b""),
        (b"2SL-12.5000;2SR12.5000\r", b""),
        (b"3SL-12.5000;3SR12.5000\r", b""),
        (b"TB?\r", b"0, 12, NO ERROR DETECTED\r\n"),
    ]);
    let usage = StageUse { homed: true, ..usage() };
    let identity = made_ready(&mut stage, &usage, &MotionOrders::default()).await.unwrap();
    assert!(identity.identity.starts_with("ESP301 Version 1.1.1"), "{}", identity.identity);
    assert!(identity.warnings.is_empty());
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn last_resort_cuts_the_power_only_where_z_holds_without_it() {
    let scripts: [(bool, Script); 2] = [(false, &[(b"ST\r", b"")]), (true, &[(b"ST\r", b""), (b"AB\r", b"")])];
    for (z_holds_unpowered, script) in scripts {
        let (mut stage, device) = stage(script);
        stage.usage = Some(StageUse { z_holds_unpowered, ..usage() });
        stage.abort().await.unwrap();
        drop(stage);
        device.await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn wrong_count_of_z_at_its_limit_is_a_mismatch_and_nothing_else_moves() {
    let (mut stage, device) = stage(&[
        (b"1AC100;1AG100;2AC100;2AG100;3AC100;3AG100\r", b""),
        (b"3MO\r", b""),
        (b"3OH2.0000;3SH12.5000;3OR3\r", b""),
        (b"3MD?;3TP;TB?\r", b"1\r\n0.0000\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"TB?\r", b"0, 11, NO ERROR DETECTED\r\n"),
        (b"3TP\r", b"0.0000\r\n"),
    ]);
    let error = stage.home_z(&usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(
        error.contains("z reads 0.0000 mm at the limit where it homed, instead of the 12.5 mm that were set (3SH)"),
        "{error}"
    );
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_search_for_home_can_be_stopped_and_nothing_else_moves() {
    let (mut stage, device) = stage(&[
        (b"1AC100;1AG100;2AC100;2AG100;3AC100;3AG100\r", b""),
        (b"3MO\r", b""),
        (b"3OH2.0000;3SH12.5000;3OR3\r", b""),
        (b"3MD?;3TP;TB?\r", b""),
        (b"ST\r", b"1\r\n0.0000\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"TB?\r", b"320, 11, AXIS-3 HOMING ABORTED\r\n"),
        (b"TB?\r", b"0, 11, NO ERROR DETECTED\r\n"),
    ]);
    let orders = MotionOrders::default();
    let ask_for_it = async {
        sleep(Duration::from_millis(30)).await;
        orders.stop();
    };
    let usage = usage();
    let (homed, ()) = tokio::join!(stage.home_z(&usage, &orders), ask_for_it);
    assert!(homed.unwrap_err().to_string().contains("AXIS-3 HOMING ABORTED"));
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_move_is_one_line_and_its_end_is_asked_for() {
    let (mut stage, device) = stage(&[
        (b"1VA10.00000;1PR-1.50000;2VA10.00000;2PR0.25000;2MD?\r", b"0\r\n"),
        (b"1MD?;2MD?;1TP;2TP;TB?\r", b"0\r\n1\r\n-1.4990\r\n0.2500\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"1MD?;2MD?;1TP;2TP;TB?\r", b"1\r\n1\r\n-1.5000\r\n0.2500\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"3TP\r", b"-10.2370\r\n"),
    ]);
    stage.send(&ways(&[(Axis::X, -1.5), (Axis::Y, 0.25)]), 10.0, &usage(), &MotionOrders::default()).await.unwrap();
    let arrived = stage.follow(&[Axis::X, Axis::Y], Duration::from_millis(50), &MotionOrders::default()).await.unwrap();
    assert_eq!(arrived, [-1.5, 0.25]);
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), -10.237);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_stop_is_sent_while_an_answer_is_awaited() {
    let (mut stage, device) = stage(&[
        (b"3MD?;3TP;TB?\r", b""),
        (b"ST\r", b"1\r\n-0.2000\r\n0, 11, NO ERROR DETECTED\r\n"),
        (b"3MD?;3TP;TB?\r", b"1\r\n-0.2000\r\n0, 11, NO ERROR DETECTED\r\n"),
    ]);
    let orders = MotionOrders::default();
    let ask_for_it = async {
        sleep(Duration::from_millis(30)).await;
        orders.stop();
    };
    let axes = [Axis::Z];
    let (followed, ()) = tokio::join!(stage.follow(&axes, Duration::from_millis(10), &orders), ask_for_it);
    followed.unwrap();
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_speed_under_way_is_sent_at_once_and_a_stop_after_it() {
    let (mut stage, device) = stage(&[
        (b"3VA2.00000\r", b""),
        (b"3VA0.50000\r", b""),
        (b"ST\r", b""),
        (b"3MD?;3TP;TB?\r", b"1\r\n-0.2000\r\n0, 11, NO ERROR DETECTED\r\n"),
    ]);
    let orders = MotionOrders::default();
    let ask_for_it = async {
        for mm_s in [2.0, 0.5] {
            sleep(Duration::from_millis(30)).await;
            orders.speed(mm_s);
        }
        sleep(Duration::from_millis(30)).await;
        orders.stop();
    };
    let axes = [Axis::Z];
    let (followed, ()) = tokio::join!(stage.follow(&axes, Duration::from_secs(10), &orders), ask_for_it);
    assert_eq!(followed.unwrap(), [-0.2]);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn stray_text_is_discarded_up_to_the_version_and_the_question_asked_again() {
    let (mut stage, device) = stage(&[
        (b"3TP\r", b"E some unsolicited text\r\n"),
        (b"VE?\r", b"-1.0\r\nESP301 Version 1.1.1 16/01/14\r\n"),
        (b"3TP\r", b"2.5000\r\n"),
    ]);
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), 2.5);
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn position_without_decimals_or_beyond_the_travel_is_refused() {
    let (mut stage, device) = stage(&[
        (b"3TP\r", b"2.5\r\n"),
        (b"VE?\r", b"ESP301 Version 1.1.1 16/01/14\r\n"),
        (b"3TP\r", b"-2.5000\r\n"),
        (b"3TP\r", b"1\r\n"),
        (b"VE?\r", b"ESP301 Version 1.1.1 16/01/14\r\n"),
        (b"3TP\r", b"92.5000\r\n"),
    ]);
    (stage.usage, stage.all_homed) = (Some(usage()), true);
    assert_eq!(stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap(), -2.5);
    assert!(
        stage
            .position_mm(Axis::Z, &MotionOrders::default())
            .await
            .unwrap_err()
            .to_string()
            .contains("a position within the travel")
    );
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_silent_controller_is_an_error_that_says_what_was_asked() {
    let (mut stage, _device) = stage(&[(b"3TP\r", b"")]);
    let error = stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "stage (ESP301 at script): while reading a position: no answer to \"3TP\" within 6000 ms"
    );
}

#[test]
fn old_firmware_is_warned_of() {
    assert!(firmware_warning("ESP301 Version 1.0.5 10/10/11").is_some());
    assert!(firmware_warning("ESP301 Version 1.1.1 16/01/14").is_none());
    assert!(firmware_warning("ESP300 Version 3.04 07/27/01").is_none());
}

#[tokio::test(start_paused = true)]
async fn queued_controller_error_is_reported_before_the_next_motion() {
    let limit = "106, 7, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED";
    let (mut stage, device) = stage(&[
        (b"1MD?;1TP;TB?\r", b"1\r\n12.5000\r\n106, 7, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED\r\n"),
        (b"1MD?;1TP;TB?\r", b"1\r\n12.5000\r\n106, 7, AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED\r\n"),
        (b"ST\r", b""),
        (b"1VA1.00000;1PR-12.50000;1MD?\r", b"0\r\n"),
    ]);
    let (orders, back) = (MotionOrders::default(), AxisWay::between(Axis::X, 12.5, 0.0));
    stage.follow(&[Axis::X], Duration::ZERO, &orders).await.unwrap();
    let refused = stage.send(&[back], 1.0, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(refused.contains(&limit.replacen("106, 7", "error 106", 1)), "{refused}");
    stage.follow(&[Axis::X], Duration::ZERO, &orders).await.unwrap();
    stage.stop().await.unwrap();
    stage.send(&[back], 1.0, &usage(), &MotionOrders::default()).await.unwrap(); // to park
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn stop_that_overtakes_its_motion_is_sent_again() {
    let (mut stage, device) = stage(&[
        (b"3TP\r", b"0.0000\r\nE stray\r\n"),
        (b"ST\r", b""),
        (b"VE?\r", b"ESP301 Version 1.1.1 16/01/14\r\n"),
        (b"3VA1.00000;3PR1.00000;3MD?\r", b"0\r\n"),
        (b"ST\r", b""),
    ]);
    let orders = MotionOrders::default();
    stage.position_mm(Axis::Z, &orders).await.unwrap();
    let ask_for_it = async {
        sleep(Duration::from_millis(30)).await; // while the line is brought back into step
        orders.stop();
    };
    let targets = ways(&[(Axis::Z, 1.0)]);
    let usage = usage();
    let (begun, ()) = tokio::join!(stage.send(&targets, 1.0, &usage, &orders), ask_for_it);
    begun.unwrap();
    drop(stage);
    device.await.unwrap();
}
