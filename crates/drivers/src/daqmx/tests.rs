//! Acquisition and load cell against a library from a script.

use super::{Acquisition, DaqmxLoadCell, Inputs, Sensitivity, Terminal};
use palpate_core::quantity::Health;
use palpate_link::device::{Identity, LoadCell};
use palpate_link::time::Instant;
use palpate_link::wire::daqmx::{Functions, NiDaqmx, TaskHandle};
use std::sync::{Arc, Mutex};

/// Inputs whose reads give, one after another: how many scans came, and what each of them is, V.
struct ScriptedInput(Mutex<Vec<(i32, Vec<f64>)>>);

impl NiDaqmx for ScriptedInput {
    fn create_task(&self, _: &str, task: &mut TaskHandle) -> i32 {
        *task = 1;
        0
    }
    fn create_ai_voltage_channel(&self, _: TaskHandle, _: &str, _: i32, _: [f64; 2]) -> i32 {
        0
    }
    fn configure_sample_clock(&self, _: TaskHandle, _: f64, _: u64) -> i32 {
        0
    }
    fn start_task(&self, _: TaskHandle) -> i32 {
        0
    }
    fn stop_task(&self, _: TaskHandle) -> i32 {
        0
    }
    fn clear_task(&self, _: TaskHandle) -> i32 {
        0
    }
    fn read_analog_f64(&self, _: TaskHandle, _: i32, buffer: &mut [f64], read: &mut i32) -> i32 {
        let (scans, volts) = self.0.lock().unwrap().remove(0);
        buffer.iter_mut().zip(volts.iter().cycle()).for_each(|(place, volts)| *place = *volts);
        *read = scans;
        0
    }
    fn extended_error_info(&self) -> String {
        String::new()
    }
    fn error_string(&self, _: i32) -> String {
        String::new()
    }
}

#[tokio::test(start_paused = true)]
async fn more_scans_than_there_can_be_and_voltages_that_no_input_reads_are_refused() {
    for (scans, volts) in [(i32::MAX, 1.0), (-1, 1.0), (1, f64::NAN), (1, 11.0), (1, f64::NEG_INFINITY)] {
        let table = ScriptedInput(Mutex::new(vec![(1, vec![0.5]), (scans, vec![volts]), (1, vec![0.25])]));
        let inputs = Inputs { physical: "Dev1/ai0".into(), count: 1, terminal: Terminal::Rse, range_v: 10.0 };
        let mut task = Acquisition::new(Functions::Here(Arc::new(table)), vec![inputs], 1000.0, "table".into());
        task.prepare().await.unwrap();
        task.after(0).await.unwrap();
        assert_eq!(task.newest(), (1, &[0.5][..]));
        let error = task.after(1).await.unwrap_err().to_string();
        assert!(error.contains("expected"), "{scans} scans of {volts} V: {error}");
        task.after(task.newest().0).await.unwrap();
        assert_eq!(task.newest().1, [0.25]);
    }
}

/// Forces on a cell with six inputs, read from one scan, V.
async fn read_axes(volts: [f64; 6], rows: [Vec<f64>; 3]) -> (Option<[f64; 2]>, f64, Health) {
    // an input before those of the cell
    let scan: Vec<f64> = [9.0].into_iter().chain(volts).collect();
    let table = ScriptedInput(Mutex::new(vec![(1, scan); 2]));
    let inputs = Inputs { physical: "Dev1/ai0:6".into(), count: 7, terminal: Terminal::Diff, range_v: 5.0 };
    let task = Acquisition::new(Functions::Here(Arc::new(table)), vec![inputs], 1000.0, "table".into());
    let identity =
        Identity { role: "load_cell".into(), identity: "table".into(), link: "table".into(), warnings: Vec::new() };
    let task = Arc::new(tokio::sync::Mutex::new(task));
    let mut cell = DaqmxLoadCell::new(task, 1, Sensitivity::Axes(rows), 5.0, 1000.0, Instant::now(), identity);
    cell.prepare().await.unwrap();
    let reading = cell.read().await.unwrap();
    (reading.side_n, reading.force_n, reading.health)
}

#[tokio::test(start_paused = true)]
async fn a_matrix_returns_three_forces_and_one_input_at_its_end_saturates_the_cell() {
    let rows = || [vec![1.0, 0.0, 0.0, 0.0, 0.0, 2.0], vec![0.0, -3.0, 0.5, 0.0, 0.0, 0.0], vec![0.25; 6]];
    let (side_n, force_n, health) = read_axes([0.5, -0.25, 1.0, 2.0, 0.125, -1.0], rows()).await;
    assert_eq!((side_n, force_n, health.saturated), (Some([-1.5, 1.25]), 0.593_75, false));
    for end_v in [4.996, -4.996] {
        // the input that no row uses much, too
        let (_, _, health) = read_axes([0.5, -0.25, 1.0, 2.0, end_v, -1.0], rows()).await;
        assert!(health.saturated && !health.fault, "{end_v} V");
    }
}
