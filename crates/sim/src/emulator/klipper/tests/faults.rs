//! What other clients of a Klipper do to it.

use super::KlipperFaultKind::Other;
use super::*;

/// A relative move of ours that states its modes.
const DOWN: &str = "SAVE_GCODE_STATE\nG91\nG1 Z-0.5 F300\nRESTORE_GCODE_STATE\nM400";

#[tokio::test(start_paused = true)]
async fn another_client_shares_coordinates_and_axes() {
    for (script, absolute, to_z_mm, position_mm) in [
        ("G92 Z0", true, -0.5, 12.0),
        ("G91", false, -0.5, 12.0),
        ("SET_KINEMATIC_POSITION Z=3", true, -0.5, 2.5),
        ("SET_GCODE_OFFSET Z=-1", true, -0.5, 12.0),
        ("SET_GCODE_OFFSET Z_ADJUST=-0.25 MOVE=1", true, -0.75, 11.75),
        ("G91\nG1 Z-1 F300\nG90", true, -1.5, 11.0),
        ("G90\nG1 X20 F6000\nG1 Z11.5\nG1 X5\nG1 Z12\nG1 X12.5", true, -1.0, 11.5),
    ] {
        let mut bench = KlipperBench::new(&[(10.0, Other(script))]);
        bench.say(&format!("{PLACED}\nG90")).await;
        bench.wait(15.0).await;
        assert_eq!(bench.field("gcode_move", "absolute_coordinates").await, absolute, "{script}");
        bench.say(DOWN).await;
        assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), POWER_ON.z_mm + to_z_mm, "{script}");
        assert_eq!(bench.field("toolhead", "position").await[2], position_mm, "{script}");
    }
}

#[tokio::test(start_paused = true)]
async fn another_client_restarts_what_shut_down_and_claims_the_place() {
    let claims = "SET_KINEMATIC_POSITION X=0 Y=0 Z=0";
    let faults = [(10.0, Shutdown), (12.0, Other("FIRMWARE_RESTART")), (20.0, Other(claims))];
    let mut bench = KlipperBench::new(&faults);
    bench.say(PLACED).await;
    bench.wait(11.0).await;
    assert_eq!(bench.field("webhooks", "state").await, "shutdown");
    assert!(bench.refused(DOWN).await.starts_with("MCU 'mcu' shutdown: Timer too close\n"));
    bench.wait(16.0).await;
    assert_eq!(bench.field("webhooks", "state").await, "ready");
    assert_eq!(bench.refused(DOWN).await, "Must home axis first: 0.000 0.000 -0.500 [0.000]");
    bench.wait(21.0).await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "xyz");
    assert_eq!(bench.field("toolhead", "position").await, json!([0.0, 0.0, 0.0, 0.0]));
    assert_eq!(bench.true_mm(Axis::Z, 21.0), POWER_ON.z_mm);
}

#[tokio::test(start_paused = true)]
async fn another_client_moves_between_two_bytes_of_a_request() {
    let request = script(DOWN);
    for bytes in [1, request.len() as u64 / 2, request.len() as u64] {
        let mut bench = KlipperBench::new(&[]);
        let fault =
            KlipperFaultAfterBytes { bytes: script(PLACED).len() as u64 + bytes, kind: Other("G91\nG1 Z-1 F300") };
        let (min_ends_mm, lengths_mm) = ([-12.5; 3], [25.0; 3]);
        let board =
            KlipperBoard { min_ends_mm, lengths_mm, faults_after_bytes: vec![fault], ..KlipperBoard::default() };
        bench.klipper = shared(KlipperEmulator::new(board, &lock(&bench.scene)));
        bench.wire = bench.open();
        bench.say(PLACED).await;
        assert_eq!(bench.ask(request.clone()).await["result"], "ok");
        assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), POWER_ON.z_mm - 1.5, "{bytes}");
    }
}
