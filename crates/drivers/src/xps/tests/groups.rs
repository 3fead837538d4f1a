//! Several groups: XY and Z, and three single axes.

use super::*;

/// Groups that may be homed, of positioners `GROUP.POSITIONER`.
fn groups(positioners: [&str; 3]) -> Grouping {
    let positioners = positioners.map(|name| {
        let (group, name) = name.split_once('.').unwrap();
        PositionerName { group: group.to_owned(), name: name.to_owned() }
    });
    Grouping { positioners, home_search: true }
}

const XY_X: [(&[u8], &[u8]); 5] = axis_script!("XY.X");
const XY_Y: [(&[u8], &[u8]); 5] = axis_script!("XY.Y");
const Z_POS: [(&[u8], &[u8]); 5] = axis_script!("Z.Pos");

#[tokio::test(start_paused = true)]
async fn with_two_groups_z_homes_and_moves_away_before_the_other_homes() {
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
                (b"GroupPositionSetpointGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
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
                (b"GroupMoveRelative(Z.Pos,12.495000)", b"0,,EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(Z)", b"-22,GroupMoveAbort(Z),EndOfAPI")],
            &[(b"GroupHomeSearch(XY)", b"0,,EndOfAPI")],
            &[(b"GroupMoveAbort(XY)", b"-22,GroupMoveAbort(XY),EndOfAPI")],
        ],
        None,
    );
    let identity = stage.identify(&usage()).await.unwrap();
    assert_eq!(identity.identity, "XPS-Q8 Firmware V2.6.4, group Z (Pos), group XY (X, Y)");
    assert!(stage.home_z(&usage(), &MotionOrders::default()).await.unwrap(), "z is in a group of its own");
    stage.home(&usage(), &MotionOrders::default()).await.unwrap();
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn z_shows_its_direction_within_its_travel_before_another_group_moves() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"GroupStatusGet(Z,int *)", b"0,12,EndOfAPI"),
                Z_POS[0],
                Z_POS[1],
                Z_POS[2],
                Z_POS[3],
                Z_POS[4],
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,11,EndOfAPI"),
                (b"PositionerSGammaParametersSet(Z.Pos,2.000000,100.000000,0.005,0.05)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,12,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,12,EndOfAPI"),
                Z_POS[0],
                Z_POS[1],
                Z_POS[2],
                Z_POS[3],
                Z_POS[4],
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,12,EndOfAPI"),
            ],
            &[(b"GroupMoveRelative(Z.Pos,1.000000)", b"0,,EndOfAPI")],
            &[],
            &[],
            &[],
        ],
        None,
    );
    assert!(stage.nudge_away(1.0, &usage(), &MotionOrders::default()).await.unwrap());
    assert!(!stage.nudge_away(1.0, &usage(), &MotionOrders::default()).await.unwrap(), "its travel ends at 12.5 mm");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn no_axis_homes_while_z_is_not_away() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"GroupStatusGet(XY,int *)", b"0,42,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,-1,EndOfAPI"),
                (b"PositionerSGammaParametersSet(Z.Pos,2.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
            ],
            &[(b"GroupMoveRelative(Z.Pos,13.495000)", b"0,,EndOfAPI")],
            &[],
            &[],
            &[],
        ],
        None,
    );
    let text = stage.bring_to_ready(1, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("z was commanded to 12.4950 mm but is at 3.0000 mm"), "{text}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn x_and_y_of_one_group_move_in_one_call_and_z_on_its_own() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [
            &[
                (b"PositionerSGammaParametersSet(Z.Pos,5.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XY.X,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"PositionerSGammaParametersSet(XY.Y,10.000000,0.000000,0,0)", b"0,,EndOfAPI"),
                (b"GroupPositionSetpointGet(XY.X,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionSetpointGet(XY.Y,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(XY,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(Z.Pos,double *)", b"0,3,EndOfAPI"),
                (b"GroupPositionCurrentGet(XY.X,double *)", b"0,1.5,EndOfAPI"),
                (b"GroupPositionCurrentGet(XY.Y,double *)", b"0,-2,EndOfAPI"),
            ],
            &[(b"GroupMoveRelative(Z.Pos,3.000000)", b""), (b"", b"0,,EndOfAPI")],
            &[],
            &[(b"GroupMoveRelative(XY,1.500000,-2.000000)", b""), (b"", b"0,,EndOfAPI")],
            &[],
        ],
        None,
    );
    // z is still under way when the others begin
    stage.send(&ways(&[(Axis::Z, 3.0)]), 5.0, &usage(), &MotionOrders::default()).await.unwrap();
    stage.send(&ways(&[(Axis::X, 1.5), (Axis::Y, -2.0)]), 10.0, &usage(), &MotionOrders::default()).await.unwrap();
    let axes = [Axis::Z, Axis::X, Axis::Y];
    assert_eq!(stage.follow(&axes, Duration::from_secs(1), &MotionOrders::default()).await.unwrap(), [3.0, 1.5, -2.0]);
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
                (b"GroupPositionSetpointGet(GX.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionSetpointGet(GY.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(GX,int *)", b"0,44,EndOfAPI"),
                (b"GroupStatusGet(GY,int *)", b"0,44,EndOfAPI"),
                (b"GroupPositionCurrentGet(GX.Pos,double *)", b"0,0.5,EndOfAPI"),
                (b"GroupPositionCurrentGet(GY.Pos,double *)", b"0,-0.5,EndOfAPI"),
            ],
            &[],
            &[(b"GroupMoveAbort(GZ)", b"-22,GroupMoveAbort(GZ),EndOfAPI")],
            &[(b"GroupMoveRelative(GX.Pos,1.500000)", b""), (b"", b"-27,GroupMoveRelative(GX.Pos,1.500000),EndOfAPI")],
            &[(b"GroupMoveAbort(GX)", b"0,,EndOfAPI")],
            &[
                (b"GroupMoveRelative(GY.Pos,-2.000000)", b""),
                (b"", b"-27,GroupMoveRelative(GY.Pos,-2.000000),EndOfAPI"),
            ],
            &[(b"GroupMoveAbort(GY)", b"0,,EndOfAPI")],
        ],
        None,
    );
    let orders = MotionOrders::default();
    stage.send(&ways(&[(Axis::X, 1.5), (Axis::Y, -2.0)]), 10.0, &usage(), &orders).await.unwrap();
    orders.stop();
    let places_mm = stage.follow(&[Axis::X, Axis::Y], Duration::from_secs(1), &orders).await.unwrap();
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
                (b"GroupPositionSetpointGet(GX.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupPositionSetpointGet(GY.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(GX,int *)", b"0,44,EndOfAPI"),
                (b"GroupStatusGet(GY,int *)", b"0,12,EndOfAPI"),
            ],
            &[],
            &[(b"GroupMoveAbort(GZ)", b"-22,GroupMoveAbort(GZ),EndOfAPI")],
            &[(b"GroupMoveRelative(GX.Pos,1.500000)", b"")],
            &[(b"GroupMoveAbort(GX)", b"0,,EndOfAPI")],
            &[(b"GroupMoveRelative(GY.Pos,-99.000000)", b"-17,GroupMoveRelative(GY.Pos,-99.000000),EndOfAPI")],
            &[(b"GroupMoveAbort(GY)", b"-22,GroupMoveAbort(GY),EndOfAPI")],
        ],
        None,
    );
    let targets = ways(&[(Axis::X, 1.5), (Axis::Y, -99.0)]);
    let text = stage.send(&targets, 10.0, &usage(), &MotionOrders::default()).await.unwrap_err().to_string();
    assert!(text.contains("error -17"), "{text}");
    done(stage, devices).await;
}

#[tokio::test(start_paused = true)]
async fn silent_abort_of_one_group_does_not_delay_the_others() {
    let (mut stage, devices) = stage_of(
        groups(["XY.X", "XY.Y", "Z.Pos"]),
        [&[], &[], &[(b"GroupMoveAbort(Z)", b"")], &[], &[(b"GroupMoveAbort(XY)", b"0,,EndOfAPI")]],
        None,
    );
    let stop = palpate_link::time::timeout(Duration::from_millis(10), stage.stop()).await;
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
                (b"GroupPositionSetpointGet(Z.Pos,double *)", b"0,0,EndOfAPI"),
                (b"GroupStatusGet(Z,int *)", b"0,44,EndOfAPI"),
                // the event that fired is gone: only the other is removed
                (b"EventExtendedRemove(2)", b"0,,EndOfAPI"),
            ],
            &[(b"GroupMoveRelative(Z.Pos,-1.250000)", b""), (b"", b"-27,GroupMoveRelative(Z.Pos,-1.250000),EndOfAPI")],
            &[],
            &[],
            &[],
        ],
        Some(guard),
    );
    stage.guard(Some(2.05)).await.unwrap();
    stage.send(&ways(&[(Axis::Z, -1.25)]), 1.5, &usage(), &MotionOrders::default()).await.unwrap();
    let error = stage.follow(&[Axis::Z], Duration::from_millis(900), &MotionOrders::default()).await.unwrap_err();
    assert!(matches!(error.problem, DeviceProblem::Guarded { limit_n } if limit_n == 2.05), "{error}");
    stage.guard(None).await.unwrap();
    done(stage, devices).await;
}
