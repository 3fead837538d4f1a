//! Table of the functions of NI's DAQmx C library that a rig needs. The table is filled from the library, loaded at run time, or
//! by an emulator. Names, parameters and codes are those of `NIDAQmx.h`.

mod library;
mod thread;

pub use library::{DaqmxLibrary, LoadError};
pub use thread::{Functions, HeldUp};

/// Handle of a task in the library.
pub type TaskHandle = usize;

/// Terminal configurations (`DAQmx_Val_RSE`, `NRSE`, `Diff`, `PseudoDiff`).
pub const RSE: i32 = 10083;
/// See [`RSE`].
pub const NRSE: i32 = 10078;
/// See [`RSE`].
pub const DIFF: i32 = 10106;
/// See [`RSE`].
pub const PSEUDO_DIFF: i32 = 12529;
/// `DAQmx_Val_Volts`.
pub(crate) const VOLTS: i32 = 10348;
/// `DAQmx_Val_Rising`.
pub const RISING: i32 = 10280;
/// `DAQmx_Val_ContSamps`.
pub(crate) const CONTINUOUS: i32 = 10123;
/// `DAQmx_Val_GroupByScanNumber`: the samples of one instant are next to each other.
pub(crate) const BY_SCAN: u32 = 1;
/// `DAQmx_Val_Auto`: all available samples.
pub const AUTO: i32 = -1;

/// Table of functions. Each function returns the library's own status: 0 is done, above 0 is a warning, below 0 is an error. No
/// function may wait, so every read has a time-out of 0.
pub trait NiDaqmx: Send + Sync {
    /// `DAQmxCreateTask`.
    fn create_task(&self, name: &str, task: &mut TaskHandle) -> i32;

    /// `DAQmxCreateAIVoltageChan` with units of volts and no custom scale. `physical` may be a range: `Dev1/ai0:8`.
    fn create_ai_voltage_channel(&self, task: TaskHandle, physical: &str, terminal: i32, range_v: [f64; 2]) -> i32;

    /// `DAQmxCfgSampClkTiming` on the device's own clock: rising edge, continuous, with a buffer of `samples_per_channel`.
    fn configure_sample_clock(&self, task: TaskHandle, rate_hz: f64, samples_per_channel: u64) -> i32;

    /// `DAQmxStartTask`.
    fn start_task(&self, task: TaskHandle) -> i32;

    /// `DAQmxStopTask`.
    fn stop_task(&self, task: TaskHandle) -> i32;

    /// `DAQmxClearTask`: removes the task.
    fn clear_task(&self, task: TaskHandle) -> i32;

    /// `DAQmxReadAnalogF64` with a time-out of 0, grouped by scan. Reads at most `samples_per_channel` ([`AUTO`]: all available)
    /// into `buffer`. `read` is the number of samples read in each channel.
    fn read_analog_f64(&self, task: TaskHandle, samples_per_channel: i32, buffer: &mut [f64], read: &mut i32) -> i32;

    /// `DAQmxGetExtendedErrorInfo`: the last error of this thread in NI's words.
    fn extended_error_info(&self) -> String;

    /// `DAQmxGetErrorString`.
    fn error_string(&self, code: i32) -> String;
}
