//! The XPS driver against answers from a script.

use super::*;
use crate::script::{Script, made_ready, scripted, unused, usage, ways};
use palpate_core::quantity::Axis;
use palpate_link::device::{DeviceProblem, LoadCell, MotionOrders, Stage};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use tokio::task::JoinHandle;

fn group(home_search: bool) -> Grouping {
    Grouping::one("XYZ", ["X", "Y", "Z"], home_search)
}

/// A driver whose sockets follow a script each: questions, then motions and aborts of each group, z's first.
fn stage_of<const N: usize>(
    grouping: Grouping,
    scripts: [Script; N],
    guard: Option<Guard>,
) -> (Xps, [JoinHandle<()>; N]) {
    let (links, devices): (Vec<_>, Vec<_>) = scripts.map(scripted).into_iter().unzip();
    let mut links = links.into_iter();
    let stage = Xps::new(|| links.next().unwrap(), "script".to_owned(), grouping, guard);
    assert!(links.next().is_none());
    (stage, devices.try_into().unwrap())
}

/// A driver whose three sockets follow a script each: motions, questions, aborts.
fn stage(scripts: [Script; 3], guard: Option<Guard>) -> (Xps, [JoinHandle<()>; 3]) {
    let [moves, asks, aborts] = scripts;
    stage_of(group(true), [asks, moves, aborts], guard)
}

/// A driver of one group that only asks.
fn asking(asks: Connector, grouping: Grouping) -> Xps {
    let mut links = [asks, unused(), unused()].into_iter();
    Xps::new(|| links.next().unwrap(), "script".to_owned(), grouping, None)
}

async fn done<const N: usize>(stage: Xps, devices: [JoinHandle<()>; N]) {
    drop(stage);
    for device in devices {
        device.await.unwrap();
    }
}

macro_rules! axis_script {
    ($name:literal) => {
        [
            (
                concat!("PositionerMaximumVelocityAndAccelerationGet(", $name, ",double *,double *)").as_bytes(),
                b"0,25,100,EndOfAPI".as_slice(),
            ),
            (
                concat!("PositionerUserTravelLimitsGet(", $name, ",double *,double *)").as_bytes(),
                b"0,-12.5,12.5,EndOfAPI",
            ),
            (concat!("PositionerUserTravelLimitsSet(", $name, ",-12.5,12.5)").as_bytes(), b"0,,EndOfAPI"),
            (
                concat!("PositionerUserTravelLimitsGet(", $name, ",double *,double *)").as_bytes(),
                b"0,-12.5,12.5,EndOfAPI",
            ),
            (
                concat!("PositionerSGammaParametersGet(", $name, ",double *,double *,double *,double *)").as_bytes(),
                b"0,20,80,0.005,0.05,EndOfAPI",
            ),
        ]
    };
}

mod groups; // it uses the macro

const X: [(&[u8], &[u8]); 5] = axis_script!("XYZ.X");
const Y: [(&[u8], &[u8]); 5] = axis_script!("XYZ.Y");
const Z: [(&[u8], &[u8]); 5] = axis_script!("XYZ.Z");

#[tokio::test(start_paused = true)]
async fn group_without_reference_is_killed_initialised_homed_and_limited() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupInitialize(XYZ)", b"0,,EndOfAPI"), (b"GroupHomeSearch(XYZ)", b"0,,EndOfAPI")],
            &[
                (b"FirmwareVersionGet(char *)", b"0,XPS-Q8 Firmware V2.6.4,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,0,EndOfAPI"),
                (b"GroupKill(XYZ)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,11,EndOfAPI"),
                X[0],
                X[1],
                X[2],
                X[3],
                X[4],
                Y[0],
                Y[1],
                Y[2],
                Y[3],
                Y[4],
                Z[0],
                Z[1],
                Z[2],
                Z[3],
                Z[4],
                (b"GroupPositionCurrentGet(XYZ.X,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Y,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,5e-06,EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(XYZ)", b"-22,GroupMoveAbort(XYZ),EndOfAPI")],
        ],
        None,
    );
    let identity = made_ready(&mut stage, &usage(), &MotionOrders::default()).await.unwrap();
    assert_eq!(identity.identity, "XPS-Q8 Firmware V2.6.4, group XYZ (X, Y, Z)");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn group_that_may_not_home_does_not_move() {
    let (asks, device) = scripted(&[(b"GroupStatusGet(XYZ,int *)", b"0,42,EndOfAPI")]);
    let mut stage = asking(asks, group(false));
    let text = stage.bring_to_ready(0, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("isn't homed") && text.contains("home_search = true"), "{text}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_motion_is_shaped_begun_and_ends_with_its_late_answer() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveRelative(XYZ.Z,-1.250000)", b""), (b"", b"0,,EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(XYZ.Z,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,-1.25,EndOfAPI"),
            ],
            &[],
        ],
        None,
    );
    stage.send(&ways(&[(Axis::Z, -1.25)]), 1.5, &usage(), &MotionOrders::default()).await.unwrap();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(900), &MotionOrders::default()).await.unwrap();
    assert_eq!(places_mm, [-1.25]);
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_target_out_of_range_is_refused_in_the_controllers_words() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveRelative(XYZ.Z,380.000000)", b"-17,GroupMoveRelative(XYZ.Z,380.000000),EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(XYZ.Z,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,12,EndOfAPI"),
            ],
            &[],
        ],
        None,
    );
    let text =
        stage.send(&ways(&[(Axis::Z, 380.0)]), 1.5, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("error -17 (parameter out of range) to GroupMoveRelative(XYZ.Z,380.000000)"), "{text}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn stop_uses_its_own_socket_and_motion_ends_with_code_27() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveRelative(XYZ.Z,-1.250000)", b""), (b"", b"-27,GroupMoveRelative(XYZ.Z,-1.250000),EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(XYZ.Z,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,-0.4,EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(XYZ)", b"0,,EndOfAPI")],
        ],
        None,
    );
    stage.send(&ways(&[(Axis::Z, -1.25)]), 1.5, &usage(), &MotionOrders::default()).await.unwrap();
    let orders = MotionOrders::default();
    orders.stop();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(900), &orders).await.unwrap();
    assert_eq!(places_mm, [-0.4]);
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn unrequested_abort_is_attributed_to_an_armed_guard() {
    let guard = Guard { input: "GPIO2.ADC1".to_owned(), newton_per_volt: 0.5 };
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveRelative(XYZ.Z,-1.250000)", b""), (b"", b"-27,GroupMoveRelative(XYZ.Z,-1.250000),EndOfAPI")],
            &[
                (
                    b"EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,4.100000,0,0,0,\
                      XYZ.SGamma.MotionState,0,0,0,0)",
                    b"0,,EndOfAPI",
                ),
                (b"EventExtendedConfigurationActionSet(XYZ.MoveAbort,0,0,0,0)", b"0,,EndOfAPI"),
                (b"EventExtendedStart(int *)", b"0,3,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(XYZ.Z,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
            ],
            &[],
        ],
        Some(guard),
    );
    stage.guard(Some(2.05)).await.unwrap();
    stage.send(&ways(&[(Axis::Z, -1.25)]), 1.5, &usage(), &MotionOrders::default()).await.unwrap();
    let error = stage.follow(&[Axis::Z], Duration::from_millis(900), &MotionOrders::default()).await.unwrap_err();
    assert!(matches!(error.problem, DeviceProblem::Guarded { limit_n } if limit_n == 2.05), "{error}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn guard_is_removed_and_a_fired_one_is_already_gone() {
    let guard = Guard { input: "GPIO2.ADC1".to_owned(), newton_per_volt: -1.0 };
    let (mut stage, devices) = stage(
        [
            &[],
            &[
                (
                    b"EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCLowLimit,-2.000000,0,0,0,\
                      XYZ.SGamma.MotionState,0,0,0,0)",
                    b"0,,EndOfAPI",
                ),
                (b"EventExtendedConfigurationActionSet(XYZ.MoveAbort,0,0,0,0)", b"0,,EndOfAPI"),
                (b"EventExtendedStart(int *)", b"0,1,EndOfAPI"),
                (b"EventExtendedRemove(1)", b"-82,EventExtendedRemove(1),EndOfAPI"),
            ],
            &[],
        ],
        Some(guard),
    );
    stage.guard(Some(2.0)).await.unwrap();
    stage.guard(None).await.unwrap();
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn position_beyond_the_travel_and_answer_to_another_call_are_refused() {
    for answer in [b"0,99.5,EndOfAPI".as_slice(), b"0,1,2,3,EndOfAPI", b"0,,EndOfAPI", b"0,nan,EndOfAPI"] {
        let script: Script = Box::leak(Box::new([(b"GroupPositionCurrentGet(XYZ.Z,double *)".as_slice(), answer)]));
        let (asks, device) = scripted(script);
        let mut stage = asking(asks, group(true));
        (stage.usage, stage.all_homed) = (Some(usage()), true);
        assert!(
            stage.position_mm(Axis::Z, &MotionOrders::default()).await.is_err(),
            "{}",
            String::from_utf8_lossy(answer)
        );
        drop(stage);
        device.await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn silent_socket_is_abandoned_in_time() {
    let (asks, device) = scripted(&[(b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,1")]);
    let mut stage = asking(asks, group(true));
    let asked = Instant::now();
    let text = stage.position_mm(Axis::Z, &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("no answer to \"GroupPositionCurrentGet(XYZ.Z,double *)\" within 2000 ms"), "{text}");
    assert_eq!(asked.elapsed(), CALL_DEADLINE);
    device.await.unwrap(); // the near end was closed: a late answer has nowhere to go
}

#[tokio::test(start_paused = true)]
async fn the_load_cell_is_a_voltage_in_newtons_and_the_ends_of_its_range_are_reported() {
    let (link, device) = scripted(&[
        (b"GPIOAnalogGet(GPIO2.ADC1,double *)", b"0,-0.25,EndOfAPI"),
        (b"GPIOAnalogGet(GPIO2.ADC1,double *)", b"0,9.995,EndOfAPI"),
        (b"GPIOAnalogGet(GPIO2.ADC1,double *)", b"0,12.5,EndOfAPI"),
    ]);
    let mut cell = XpsAnalog::new(link, "script".to_owned(), "GPIO2.ADC1", 2.0, 200.0, Instant::now());
    assert_eq!(cell.read().await.unwrap().force_n, -0.5);
    assert!(cell.read().await.unwrap().health.saturated);
    assert!(cell.read().await.unwrap_err().to_string().contains("a voltage within +-10 V"));
    drop(cell);
    device.await.unwrap();
}
