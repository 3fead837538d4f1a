//! The XPS driver against answers from a script.

use super::*;
use crate::device::{DeviceProblem, LoadCell, Reins, Stage};
use crate::driver::script::{Script, made_ready, scripted, unused, usage};
use crate::quantity::Axis;
use crate::wire::Connector;
use tokio::task::JoinHandle;
use tokio::time::Instant;

fn group(home_search: bool) -> Grouping {
    Grouping::one("XYZ", ["X", "Y", "Z"], home_search)
}

/// Groups that may be homed, of positioners `GROUP.POSITIONER`.
fn groups(positioners: [&str; 3]) -> Grouping {
    let positioners = positioners.map(|name| {
        let (group, name) = name.split_once('.').unwrap();
        Positioner { group: group.to_owned(), name: name.to_owned() }
    });
    Grouping { positioners, home_search: true }
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

const X: [(&[u8], &[u8]); 5] = axis_script!("XYZ.X");
const Y: [(&[u8], &[u8]); 5] = axis_script!("XYZ.Y");
const Z: [(&[u8], &[u8]); 5] = axis_script!("XYZ.Z");

#[tokio::test(start_paused = true)]
async fn a_cold_group_is_killed_initialised_homed_and_limited() {
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
    let identity = made_ready(&mut stage, &usage(), &Reins::default()).await.unwrap();
    assert_eq!(identity.identity, "XPS-Q8 Firmware V2.6.4, group XYZ (X, Y, Z)");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_group_that_may_not_be_homed_is_left_where_it_is() {
    let (asks, device) = scripted(&[(b"GroupStatusGet(XYZ,int *)", b"0,42,EndOfAPI")]);
    let mut stage = asking(asks, group(false));
    let told = stage.bring_to_ready(0, &usage(), &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("isn't homed") && told.contains("home_search = true"), "{told}");
    drop(stage);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_motion_is_shaped_begun_and_ends_with_its_late_answer() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveAbsolute(XYZ.Z,-1.250000)", b""), (b"", b"0,,EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,-1.25,EndOfAPI"),
            ],
            &[],
        ],
        None,
    );
    stage.begin(&[(Axis::Z, -1.25)], 1.5, &Reins::default()).await.unwrap();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(900), &Reins::default()).await.unwrap();
    assert_eq!(places_mm, [-1.25]);
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_target_out_of_range_is_refused_in_the_controllers_words() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveAbsolute(XYZ.Z,380.000000)", b"-17,GroupMoveAbsolute(XYZ.Z,380.000000),EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,12,EndOfAPI"),
            ],
            &[],
        ],
        None,
    );
    let told = stage.begin(&[(Axis::Z, 380.0)], 1.5, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("error -17 (parameter out of range) to GroupMoveAbsolute(XYZ.Z,380.000000)"), "{told}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_stop_goes_over_its_own_socket_at_once_and_the_motion_says_27() {
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveAbsolute(XYZ.Z,-1.250000)", b""), (b"", b"-27,GroupMoveAbsolute(XYZ.Z,-1.250000),EndOfAPI")],
            &[
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,-0.4,EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(XYZ)", b"0,,EndOfAPI")],
        ],
        None,
    );
    stage.begin(&[(Axis::Z, -1.25)], 1.5, &Reins::default()).await.unwrap();
    let reins = Reins::default();
    reins.stop();
    let places_mm = stage.follow(&[Axis::Z], Duration::from_millis(900), &reins).await.unwrap();
    assert_eq!(places_mm, [-0.4]);
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn an_abort_that_nobody_here_asked_for_is_the_guards_if_it_is_armed() {
    let guard = Guard { input: "GPIO2.ADC1".to_owned(), newton_per_volt: 0.5 };
    let (mut stage, devices) = stage(
        [
            &[(b"GroupMoveAbsolute(XYZ.Z,-1.250000)", b""), (b"", b"-27,GroupMoveAbsolute(XYZ.Z,-1.250000),EndOfAPI")],
            &[
                (
                    b"EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,4.100000,0,0,0,\
                      XYZ.SGamma.MotionState,0,0,0,0)",
                    b"0,,EndOfAPI",
                ),
                (b"EventExtendedConfigurationActionSet(XYZ.MoveAbort,0,0,0,0)", b"0,,EndOfAPI"),
                (b"EventExtendedStart(int *)", b"0,3,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XYZ.Z,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XYZ,int *)", b"0,44,EndOfAPI"),
            ],
            &[],
        ],
        Some(guard),
    );
    stage.guard(Some(2.05)).await.unwrap();
    stage.begin(&[(Axis::Z, -1.25)], 1.5, &Reins::default()).await.unwrap();
    let error = stage.follow(&[Axis::Z], Duration::from_millis(900), &Reins::default()).await.unwrap_err();
    assert!(matches!(error.problem, DeviceProblem::Guarded { limit_n } if limit_n == 2.05), "{error}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_guard_is_removed_and_one_that_fired_is_gone_already() {
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
async fn a_place_beyond_the_travel_and_anothers_answer_are_refused() {
    for answer in [b"0,99.5,EndOfAPI".as_slice(), b"0,1,2,3,EndOfAPI", b"0,,EndOfAPI", b"0,nan,EndOfAPI"] {
        let script: Script = Box::leak(Box::new([(b"GroupPositionCurrentGet(XYZ.Z,double *)".as_slice(), answer)]));
        let (asks, device) = scripted(script);
        let mut stage = asking(asks, group(true));
        stage.usage = Some(usage());
        assert!(stage.position_mm(Axis::Z, &Reins::default()).await.is_err(), "{}", String::from_utf8_lossy(answer));
        drop(stage);
        device.await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn a_silent_socket_is_given_up_in_time_and_not_used_again() {
    let (asks, device) = scripted(&[(b"GroupPositionCurrentGet(XYZ.Z,double *)", b"0,1")]);
    let mut stage = asking(asks, group(true));
    let asked = Instant::now();
    let told = stage.position_mm(Axis::Z, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("no answer to \"GroupPositionCurrentGet(XYZ.Z,double *)\" within 2000 ms"), "{told}");
    assert_eq!(asked.elapsed(), CALL_DEADLINE);
    device.await.unwrap(); // the near end was closed: a late answer has nowhere to go
}

#[tokio::test(start_paused = true)]
async fn the_load_cell_is_a_voltage_in_newtons_and_the_ends_of_its_range_are_told() {
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

const XY_X: [(&[u8], &[u8]); 5] = axis_script!("XY.X");
const XY_Y: [(&[u8], &[u8]); 5] = axis_script!("XY.Y");
const Z_POS: [(&[u8], &[u8]); 5] = axis_script!("Z.Pos");

#[tokio::test(start_paused = true)]
async fn of_two_cold_groups_z_is_homed_first_and_goes_away_before_the_other_searches() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"FirmwareVersionGet(char *)", b"0,XPS-Q8 Firmware V2.6.4,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XY,int *)", b"0,42,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,0,EndOfAPI"),
                (b"GroupKill(Z)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,11,EndOfAPI"),
                Z_POS[0],
                Z_POS[1],
                Z_POS[2],
                Z_POS[3],
                Z_POS[4],
                // home: z is ready, the other isn't
                (b"GroupStatusGet(Z,int *)", b"0,11,EndOfAPI"),
                Z_POS[0],
                Z_POS[1],
                Z_POS[2],
                Z_POS[3],
                Z_POS[4],
                (b"GroupStatusGet(XY,int *)", b"0,42,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
                (b"PositionerSGammaParametersSet(Z.Pos,2.000000,100.000000,0.005,0.05)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,12.5,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,12.5,EndOfAPI"),
                (b"GroupStatusGet(XY,int *)", b"0,11,EndOfAPI"),
                XY_X[0],
                XY_X[1],
                XY_X[2],
                XY_X[3],
                XY_X[4],
                XY_Y[0],
                XY_Y[1],
                XY_Y[2],
                XY_Y[3],
                XY_Y[4],
                (b"GroupPositionCurrentGet(XY.X,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionCurrentGet(XY.Y,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,12.5,EndOfAPI"),
            ],
            &[
                (b"GroupInitialize(Z)", b"0,,EndOfAPI"),
                (b"GroupHomeSearch(Z)", b"0,,EndOfAPI"),
                (b"GroupMoveAbsolute(Z.Pos,12.500000)", b"0,,EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(Z)", b"-22,GroupMoveAbort(Z),EndOfAPI")],
            &[(b"GroupHomeSearch(XY)", b"0,,EndOfAPI")],
            &[(b"GroupMoveAbort(XY)", b"-22,GroupMoveAbort(XY),EndOfAPI")],
        ],
        None,
    );
    let identity = stage.identify(&usage()).await.unwrap();
    assert_eq!(identity.identity, "XPS-Q8 Firmware V2.6.4, group Z (Pos), group XY (X, Y)");
    assert!(stage.home_z(&usage(), &Reins::default()).await.unwrap(), "z is in a group of its own");
    stage.home(&usage(), &Reins::default()).await.unwrap();
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn nothing_searches_for_home_while_z_isnt_away() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"GroupStatusGet(XY,int *)", b"0,42,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,-1,EndOfAPI"),
                (b"PositionerSGammaParametersSet(Z.Pos,2.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
            ],
            &[(b"GroupMoveAbsolute(Z.Pos,12.500000)", b"0,,EndOfAPI")],
            &[],
            &[],
            &[],
        ],
        None,
    );
    let told = stage.bring_to_ready(1, &usage(), &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("z was commanded to 12.5000 mm but is at 3.0000 mm"), "{told}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn x_and_y_of_one_group_move_in_one_call_and_z_on_its_own() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"PositionerSGammaParametersSet(Z.Pos,5.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XY.X,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XY.Y,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(XY,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
                (b"GroupPositionCurrentGet(XY.X,double *)", b"0,1.5,EndOfAPI"),
                (b"GroupPositionCurrentGet(XY.Y,double *)", b"0,-2,EndOfAPI"),
            ],
            &[(b"GroupMoveAbsolute(Z.Pos,3.000000)", b""), (b"", b"0,,EndOfAPI")],
            &[],
            &[(b"GroupMoveAbsolute(XY,1.500000,-2.000000)", b""), (b"", b"0,,EndOfAPI")],
            &[],
        ],
        None,
    );
    // z is still under way when the others begin
    stage.begin(&[(Axis::Z, 3.0)], 5.0, &Reins::default()).await.unwrap();
    stage.begin(&[(Axis::X, 1.5), (Axis::Y, -2.0)], 10.0, &Reins::default()).await.unwrap();
    let axes = [Axis::Z, Axis::X, Axis::Y];
    assert_eq!(stage.follow(&axes, Duration::from_secs(1), &Reins::default()).await.unwrap(), [3.0, 1.5, -2.0]);
    done(stage, devices).await;
}

const SINGLE: [&str; 3] = ["GX.Pos", "GY.Pos", "GZ.Pos"];

#[tokio::test(start_paused = true)]
async fn three_single_axes_begin_together_and_a_stop_reaches_all_at_once() {
    let (mut stage, devices) = stage_of(
        groups(SINGLE),
        [
            &[
                (b"PositionerSGammaParametersSet(GX.Pos,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"PositionerSGammaParametersSet(GY.Pos,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(GX,int *)", b"0,44,EndOfAPI"),
                (b"GroupStatusGet(GY,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(GX.Pos,double *)", b"0,0.5,EndOfAPI"),
                (b"GroupPositionCurrentGet(GY.Pos,double *)", b"0,-0.5,EndOfAPI"),
            ],
            &[],
            &[(b"GroupMoveAbort(GZ)", b"-22,GroupMoveAbort(GZ),EndOfAPI")],
            &[(b"GroupMoveAbsolute(GX.Pos,1.500000)", b""), (b"", b"-27,GroupMoveAbsolute(GX.Pos,1.500000),EndOfAPI")],
            &[(b"GroupMoveAbort(GX)", b"0,,EndOfAPI")],
            &[
                (b"GroupMoveAbsolute(GY.Pos,-2.000000)", b""),
                (b"", b"-27,GroupMoveAbsolute(GY.Pos,-2.000000),EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(GY)", b"0,,EndOfAPI")],
        ],
        None,
    );
    let reins = Reins::default();
    stage.begin(&[(Axis::X, 1.5), (Axis::Y, -2.0)], 10.0, &reins).await.unwrap();
    reins.stop();
    let places_mm = stage.follow(&[Axis::X, Axis::Y], Duration::from_secs(1), &reins).await.unwrap();
    assert_eq!(places_mm, [0.5, -0.5]);
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn if_one_group_refuses_its_motion_the_other_is_stopped() {
    let (mut stage, devices) = stage_of(
        groups(SINGLE),
        [
            &[
                (b"PositionerSGammaParametersSet(GX.Pos,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"PositionerSGammaParametersSet(GY.Pos,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(GX,int *)", b"0,44,EndOfAPI"),
                (b"GroupStatusGet(GY,int *)", b"0,12,EndOfAPI"),
            ],
            &[],
            &[(b"GroupMoveAbort(GZ)", b"-22,GroupMoveAbort(GZ),EndOfAPI")],
            &[(b"GroupMoveAbsolute(GX.Pos,1.500000)", b"")],
            &[(b"GroupMoveAbort(GX)", b"0,,EndOfAPI")],
            &[(b"GroupMoveAbsolute(GY.Pos,-99.000000)", b"-17,GroupMoveAbsolute(GY.Pos,-99.000000),EndOfAPI")],
            &[(b"GroupMoveAbort(GY)", b"-22,GroupMoveAbort(GY),EndOfAPI")],
        ],
        None,
    );
    let targets = [(Axis::X, 1.5), (Axis::Y, -99.0)];
    let told = stage.begin(&targets, 10.0, &Reins::default()).await.unwrap_err().to_string();
    assert!(told.contains("error -17"), "{told}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn a_silent_abort_of_one_group_delays_no_other() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [&[], &[], &[(b"GroupMoveAbort(Z)", b"")], &[], &[(b"GroupMoveAbort(XY)", b"0,,EndOfAPI")]],
        None,
    );
    let stop = tokio::time::timeout(Duration::from_millis(10), stage.stop()).await;
    assert!(stop.is_err(), "z's abort isn't answered");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn each_group_has_a_guard_and_the_one_that_fired_is_named() {
    let guard = Guard { input: "GPIO2.ADC1".to_owned(), newton_per_volt: 0.5 };
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (
                    b"EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,4.100000,0,0,0,\
                      Z.SGamma.MotionState,0,0,0,0)",
                    b"0,,EndOfAPI",
                ),
                (b"EventExtendedConfigurationActionSet(Z.MoveAbort,0,0,0,0)", b"0,,EndOfAPI"),
                (b"EventExtendedStart(int *)", b"0,1,EndOfAPI"),
                (
                    b"EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCHighLimit,4.100000,0,0,0,\
                      XY.SGamma.MotionState,0,0,0,0)",
                    b"0,,EndOfAPI",
                ),
                (b"EventExtendedConfigurationActionSet(XY.MoveAbort,0,0,0,0)", b"0,,EndOfAPI"),
                (b"EventExtendedStart(int *)", b"0,2,EndOfAPI"),
                (b"PositionerSGammaParametersSet(Z.Pos,1.500000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                // the event that fired is gone: only the other is removed
                (b"EventExtendedRemove(2)", b"0,,EndOfAPI"),
            ],
            &[(b"GroupMoveAbsolute(Z.Pos,-1.250000)", b""), (b"", b"-27,GroupMoveAbsolute(Z.Pos,-1.250000),EndOfAPI")],
            &[],
            &[],
            &[],
        ],
        Some(guard),
    );
    stage.guard(Some(2.05)).await.unwrap();
    stage.begin(&[(Axis::Z, -1.25)], 1.5, &Reins::default()).await.unwrap();
    let error = stage.follow(&[Axis::Z], Duration::from_millis(900), &Reins::default()).await.unwrap_err();
    assert!(matches!(error.problem, DeviceProblem::Guarded { limit_n } if limit_n == 2.05), "{error}");
    stage.guard(None).await.unwrap();
    done(stage, devices).await;
}
