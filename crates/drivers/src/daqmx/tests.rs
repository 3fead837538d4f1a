//! The acquisition against a library from a script.

use super::{Acquisition, Inputs, Terminal};
use palpate_link::wire::daqmx::{Functions, NiDaqmx, TaskHandle};
use std::sync::{Arc, Mutex};

/// One input whose reads give, one after another: how many scans came, and what all of them are, V.
struct ScriptedInput(Mutex<Vec<(i32, f64)>>);

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
        buffer.fill(volts);
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
        let table = ScriptedInput(Mutex::new(vec![(1, 0.5), (scans, volts), (1, 0.25)]));
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
