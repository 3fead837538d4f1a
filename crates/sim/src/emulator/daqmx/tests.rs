//! The library, function by function.

use super::*;
use crate::emulator::tests::{STIFFNESS_N_MM, pressed, scene, scene_with, shared};
use crate::scene::{FaultKind, SceneFault, Trajectory};
use palpate_core::quantity::{Axis, Tilt};
use palpate_link::time::sleep;
use palpate_link::wire::daqmx::{DIFF, PSEUDO_DIFF, RSE};
use proptest::prelude::*;
use std::time::Duration;

/// The load cell on ai9, the nine taxels on ai0 to ai8, 2 V/N.
fn emulator(scene: Scene) -> DaqmxEmulator {
    DaqmxEmulator::new(shared(scene), Instant::now(), "Dev1", Some(9), 0, 2.0)
}

/// A task that reads some inputs at 10 V and runs.
fn running(daqmx: &DaqmxEmulator, physical: &str, rate_hz: f64, scans: u64) -> TaskHandle {
    let task = prepared(daqmx, physical, rate_hz, scans);
    assert_eq!(daqmx.start_task(task), 0, "{}", daqmx.extended_error_info());
    task
}

fn prepared(daqmx: &DaqmxEmulator, physical: &str, rate_hz: f64, scans: u64) -> TaskHandle {
    let mut task = 0;
    assert_eq!(daqmx.create_task("", &mut task), 0);
    assert_eq!(daqmx.create_ai_voltage_channel(task, physical, RSE, [-10.0, 10.0]), 0);
    assert_eq!(daqmx.configure_sample_clock(task, rate_hz, scans), 0);
    task
}

/// All that is there, or the error.
fn read(daqmx: &DaqmxEmulator, task: TaskHandle) -> Result<Vec<f64>, i32> {
    let (mut buffer, mut scans) = (vec![f64::NAN; 100_000], 0);
    match daqmx.read_analog_f64(task, AUTO, &mut buffer, &mut scans) {
        0 => {
            let samples = buffer.iter().take_while(|sample| !sample.is_nan()).count();
            assert!(scans == 0 && samples == 0 || samples.is_multiple_of(scans as usize));
            buffer.truncate(samples);
            Ok(buffer)
        }
        status => Err(status),
    }
}

async fn wait_ms(ms: u64) {
    sleep(Duration::from_millis(ms)).await;
}

#[tokio::test(start_paused = true)]
async fn scans_come_at_their_rate_a_millisecond_late_and_once() {
    let daqmx = emulator(scene());
    let task = running(&daqmx, "Dev1/ai0:8,Dev1/ai9", 1000.0, 1000);
    assert_eq!(read(&daqmx, task), Ok(vec![]));
    wait_ms(1).await;
    assert_eq!(read(&daqmx, task), Ok(vec![0.0; 10]));
    assert_eq!(read(&daqmx, task), Ok(vec![]));
    for ms in [1, 7, 100] {
        wait_ms(ms).await;
        assert_eq!(read(&daqmx, task).map(|samples| samples.len()), Ok(10 * ms as usize));
    }
}

#[tokio::test(start_paused = true)]
async fn a_press_is_read_in_volts_by_cell_and_taxels() {
    let daqmx = emulator(pressed(1.0));
    let task = running(&daqmx, "Dev1/ai9,Dev1/ai0:8,Dev1/ai20", 100.0, 100);
    wait_ms(1).await;
    let volts = read(&daqmx, task).expect("a scan");
    let mut outputs = [0.0; 9];
    daqmx.scene.lock().expect("sound").outputs(0.001, &mut outputs);
    assert!((volts[0] - 2.0).abs() < 2e-4 && volts[10] == 0.0, "{volts:?}");
    assert!(outputs[4] > 0.1);
    for (volts, output) in volts[1..10].iter().zip(outputs) {
        assert!((volts - output).abs() <= 10.0 / 65_536.0 + 1e-12, "{volts} V, {output}");
    }
}

#[tokio::test(start_paused = true)]
async fn bridges_of_a_cell_with_three_axes_carry_the_whole_force() {
    // on ai12, ai11 and ai3, in this order; the taxels are on ai0 to ai8
    let volts_per_newton = vec![[0.5, 0.0, 1.0], [0.0, 0.25, -2.0], [1.0, 1.0, 0.5]];
    let tilted = scene_with(|spec| spec.surface_tilt = Tilt { per_x: 0.05, per_y: -0.02 });
    let daqmx = DaqmxEmulator::new(shared(tilted), Instant::now(), "Dev1", None, 0, 1.0)
        .with_axes("Dev1/ai12:11,Dev1/ai3", volts_per_newton.clone());
    let to = Trajectory::at_rest(-1.5 / STIFFNESS_N_MM);
    daqmx.scene.lock().expect("sound").set_motion(Axis::Z, to, 0.0);
    let task = running(&daqmx, "Dev1/ai3,Dev1/ai11:12", 100.0, 100);
    wait_ms(1).await;
    let volts = read(&daqmx, task).expect("a scan");
    let forces_n = daqmx.scene.lock().expect("sound").load_cell_axes_n(0.001);
    assert!(forces_n[2] > 1.0 && forces_n[0].abs() > 0.05 && forces_n[1].abs() > 0.02, "{forces_n:?}");
    for (volts, input) in volts.iter().zip([2, 1, 0]) {
        let row: &[f64; 3] = &volts_per_newton[input];
        let expected_v: f64 = row.iter().zip(forces_n).map(|(volts, force_n)| volts * force_n).sum();
        assert!((volts - expected_v).abs() <= 10.0 / 65_536.0 + 1e-12, "input {input}: {volts} V, {expected_v} V");
    }
}

#[tokio::test(start_paused = true)]
async fn a_differential_channel_is_the_difference_of_its_two_inputs_and_a_range_clips() {
    let daqmx = DaqmxEmulator::new(shared(pressed(3.0)), Instant::now(), "Dev1", Some(8), 10, 2.0);
    let mut task = 0;
    assert_eq!(daqmx.create_task("cell", &mut task), 0);
    assert_eq!(daqmx.create_ai_voltage_channel(task, "Dev1/ai0", DIFF, [-10.0, 10.0]), 0);
    assert_eq!(daqmx.create_ai_voltage_channel(task, "Dev1/ai8", RSE, [-1.0, 1.0]), 0);
    assert_eq!(daqmx.configure_sample_clock(task, 10.0, 10), 0);
    assert_eq!(daqmx.start_task(task), 0);
    wait_ms(1).await;
    let volts = read(&daqmx, task).expect("a scan");
    assert!((volts[0] + 6.0).abs() < 2e-4, "{volts:?}");
    assert!((volts[1] - 1.0).abs() < 4e-5, "{volts:?}");
}

#[tokio::test(start_paused = true)]
async fn scans_that_piled_up_lie_on_a_line_to_the_newest() {
    let daqmx = emulator(pressed(1.0));
    let task = running(&daqmx, "Dev1/ai9", 1000.0, 1000);
    wait_ms(1).await;
    read(&daqmx, task).expect("a scan");
    {
        let mut scene = daqmx.scene.lock().expect("sound");
        let from_mm = -1.0 / STIFFNESS_N_MM;
        let way = Trajectory::to(0.001, (from_mm, 0.0), 2.0 * from_mm, 25.0, 1e5);
        scene.set_motion(Axis::Z, way, 0.001);
    }
    wait_ms(100).await;
    let volts = read(&daqmx, task).expect("scans");
    assert_eq!(volts.len(), 100);
    for (n, volts) in volts.iter().enumerate() {
        let expected_v = 2.0 + 2.0 * (n + 1) as f64 / 100.0;
        assert!((volts - expected_v).abs() < 4e-4, "{volts} V, {expected_v} V expected");
    }
}

#[tokio::test(start_paused = true)]
async fn requested_number_of_samples_is_read_or_none() {
    let daqmx = emulator(scene());
    let task = running(&daqmx, "Dev1/ai0:1", 1000.0, 100);
    wait_ms(10).await;
    let (mut buffer, mut scans) = ([1.0; 20], -1);
    assert_eq!(daqmx.read_analog_f64(task, 4, &mut buffer, &mut scans), 0);
    assert_eq!((scans, buffer[7], buffer[8]), (4, 0.0, 1.0));
    assert_eq!(daqmx.read_analog_f64(task, 7, &mut buffer, &mut scans), -200284);
    assert_eq!(scans, 0);
    assert_eq!(daqmx.read_analog_f64(task, 0, &mut buffer, &mut scans), 0);
    assert_eq!(daqmx.read_analog_f64(task, -2, &mut buffer, &mut scans), -200077);
    assert_eq!(daqmx.read_analog_f64(task, 6, &mut buffer[..11], &mut scans), -200229);
    assert_eq!(daqmx.read_analog_f64(task, AUTO, &mut buffer[..11], &mut scans), -200229);
    assert_eq!(daqmx.read_analog_f64(task, 6, &mut buffer, &mut scans), 0);
    assert_eq!(scans, 6);
}

#[tokio::test(start_paused = true)]
async fn unread_samples_are_lost_and_reported_until_restart() {
    let daqmx = emulator(scene());
    let task = running(&daqmx, "Dev1/ai0", 1000.0, 50);
    wait_ms(50).await;
    assert_eq!(read(&daqmx, task).map(|samples| samples.len()), Ok(50));
    wait_ms(51).await;
    assert_eq!(read(&daqmx, task), Err(-200279));
    let text = daqmx.extended_error_info();
    assert!(text.ends_with("\n\nTask Name: _unnamedTask<0>\n\nStatus Code: -200279"), "{text}");
    wait_ms(1).await;
    assert_eq!(read(&daqmx, task), Err(-200279));
    assert_eq!((daqmx.stop_task(task), daqmx.start_task(task)), (0, 0));
    wait_ms(2).await;
    assert_eq!(read(&daqmx, task), Ok(vec![0.0; 2]));
}

#[tokio::test(start_paused = true)]
async fn silent_link_delivers_no_scans() {
    let stale = SceneFault { kind: FaultKind::Stale, from_s: 0.01, value: None };
    let daqmx = emulator(scene_with(|spec| spec.faults.push(stale)));
    let task = running(&daqmx, "Dev1/ai9", 1000.0, 1000);
    wait_ms(5).await;
    assert_eq!(read(&daqmx, task).map(|samples| samples.len()), Ok(5));
    wait_ms(100).await;
    assert_eq!(read(&daqmx, task), Ok(vec![]));
    let mut scans = 0;
    assert_eq!(daqmx.read_analog_f64(task, 1, &mut [0.0], &mut scans), -200284);
}

#[tokio::test(start_paused = true)]
async fn impossible_tasks_are_refused() {
    let daqmx = emulator(scene());
    let (mut task, mut scans) = (0, 0);
    assert_eq!(daqmx.create_task("cell", &mut task), 0);
    assert_eq!(daqmx.create_task("cell", &mut 0), -200089);
    assert_eq!(daqmx.start_task(task), -200478);
    assert!(daqmx.extended_error_info().ends_with("Task Name: cell\n\nStatus Code: -200478"));
    let channel =
        |physical, terminal, most_v: f64| daqmx.create_ai_voltage_channel(task, physical, terminal, [-most_v, most_v]);
    assert_eq!(channel("Dev2/ai0", RSE, 10.0), -200220);
    assert_eq!(channel("Dev1/ai32", RSE, 10.0), -200170);
    assert_eq!(channel("Dev1/ai8", DIFF, 10.0), -200077);
    assert_eq!(channel("Dev1/ai0", PSEUDO_DIFF, 10.0), -200077);
    assert_eq!(channel("Dev1/ai0", RSE, 10.5), -200077);
    assert_eq!(channel("Dev1/ai0:9", RSE, 10.0), 0);
    assert_eq!(daqmx.start_task(task), -200077);
    assert_eq!(daqmx.configure_sample_clock(task, 0.0, 100), -200077);
    assert_eq!(daqmx.configure_sample_clock(task, 1000.0, 0), -200077);
    assert_eq!(daqmx.configure_sample_clock(task, 50_001.0, 100), 0);
    // ten channels: 500,010 a second
    assert_eq!(daqmx.start_task(task), -200077);
    assert_eq!(daqmx.configure_sample_clock(task, 50_000.0, 100), 0);
    assert_eq!(daqmx.read_analog_f64(task, AUTO, &mut [], &mut scans), -200088);
    assert_eq!((daqmx.start_task(task), daqmx.start_task(task)), (0, -200479));
    assert_eq!(channel("Dev1/ai0", RSE, 10.0), -200479);
    assert_eq!(daqmx.configure_sample_clock(task, 1000.0, 100), -200479);
    let second = prepared(&daqmx, "Dev1/ai20", 10.0, 10);
    assert_eq!(daqmx.start_task(second), -50103);
    assert_eq!((daqmx.clear_task(task), daqmx.start_task(second)), (0, 0));
    assert_eq!(daqmx.clear_task(task), -200088);
    assert!(daqmx.error_string(-200088).ends_with("\n\nStatus Code: -200088"));
    assert_eq!(daqmx.error_string(0), "");
    assert!(daqmx.error_string(-1).ends_with("\n\nStatus Code: -1"));
    for task in [0, 1, 99] {
        assert_eq!((daqmx.stop_task(task), daqmx.start_task(task)), (-200088, -200088));
    }
    for _ in 1..TASKS_MOST {
        assert_eq!(daqmx.create_task("", &mut task), 0);
    }
    assert_eq!(daqmx.create_task("", &mut task), -50352);
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_channel_names(physical in "(Dev1/ai[0-9:]{0,4},?){0,3}|.{0,20}", terminal in -2i32..3) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().expect("a runtime");
        let _entered = runtime.enter();
        let daqmx = emulator(scene());
        let mut task = 0;
        daqmx.create_task("", &mut task);
        let status = daqmx.create_ai_voltage_channel(task, &physical, [10083, -1, 10106, 7, 0][(terminal + 2) as usize], [-1.0, 1.0]);
        prop_assert!(status == 0 || DaqmxStatus(status).text().is_some());
    }
}
