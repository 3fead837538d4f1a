//! The only place with foreign functions. Each pointer is looked up once by its name in `NIDAQmx.h` and has the signature of that
//! header. Buffers are passed with their lengths.
#![allow(unsafe_code, reason = "a C library is called: NI gives no other interface")]

use super::{BY_SCAN, CONTINUOUS, NiDaqmx, RISING, TaskHandle, VOLTS};
use libloading::Library;
use std::ffi::{CString, c_char, c_void};

/// Size of a buffer for the library's text, bytes. A longer text is cut.
const TEXT_BYTES: usize = 2048;

/// Error code of an invalid parameter (`DAQmxErrorInvalidAttributeValue`). It is returned for a text that contains a zero byte.
const BAD_VALUE: i32 = -200_077;

/// Location of the library on each system: the file's name, or the path to which its installer copies it.
#[cfg(windows)]
const PLACES: [&str; 1] = ["nicaiu.dll"];
#[cfg(not(windows))]
const PLACES: [&str; 3] =
    ["libnidaqmx.so", "/usr/lib/x86_64-linux-gnu/libnidaqmx.so", "/usr/local/natinst/lib/libnidaqmx.so"];

type NiHandle = *mut c_void;

// `extern "system"` is stdcall on 32-bit Windows, as the header says, and C's own convention everywhere else.
type CreateTask = unsafe extern "system" fn(*const c_char, *mut NiHandle) -> i32;
type CreateAiVoltageChannel =
    unsafe extern "system" fn(NiHandle, *const c_char, *const c_char, i32, f64, f64, i32, *const c_char) -> i32;
type ConfigureSampleClock = unsafe extern "system" fn(NiHandle, *const c_char, f64, i32, i32, u64) -> i32;
type OnTask = unsafe extern "system" fn(NiHandle) -> i32;
type ReadAnalogF64 = unsafe extern "system" fn(NiHandle, i32, f64, u32, *mut f64, u32, *mut i32, *mut u32) -> i32;
type ExtendedErrorInfo = unsafe extern "system" fn(*mut c_char, u32) -> i32;
type ErrorString = unsafe extern "system" fn(i32, *mut c_char, u32) -> i32;

/// The loaded library, and the functions of it that are used.
pub struct DaqmxLibrary {
    create_task: CreateTask,
    create_ai_voltage_channel: CreateAiVoltageChannel,
    configure_sample_clock: ConfigureSampleClock,
    start_task: OnTask,
    stop_task: OnTask,
    clear_task: OnTask,
    read_analog_f64: ReadAnalogF64,
    extended_error_info: ExtendedErrorInfo,
    error_string: ErrorString,
    /// Library, kept because the functions would disappear without it.
    _library: Library,
}

/// Reason why the library can't be used.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The library isn't found.
    #[error("NI's DAQmx library wasn't found on this machine ({tried}): {text}")]
    Missing {
        /// Names that were tried.
        tried: String,
        /// The system's error for the last of them.
        text: String,
    },
    /// The library isn't the expected one.
    #[error("{path} isn't NI's DAQmx library: it has no function {function}")]
    Foreign {
        /// File of the library.
        path: String,
        /// Function that is missing in the library.
        function: &'static str,
    },
}

impl DaqmxLibrary {
    /// Loads the library of this path, or the system's own.
    ///
    /// # Errors
    /// The library isn't found, or lacks a function.
    pub fn load(path: Option<&str>) -> Result<DaqmxLibrary, LoadError> {
        let places = path.map_or_else(|| PLACES.to_vec(), |path| vec![path]);
        let mut text = String::new();
        for place in &places {
            // SAFETY: loading runs the library's own start-up code, which is what a person asks for who names it
            match unsafe { Library::new(*place) } {
                Ok(library) => return Self::of(library, place),
                Err(error) => text = error.to_string(),
            }
        }
        Err(LoadError::Missing { tried: places.join(", "), text })
    }

    fn of(library: Library, path: &str) -> Result<DaqmxLibrary, LoadError> {
        /// Returns a function of the library, found by its name.
        fn function<T: Copy>(library: &Library, path: &str, name: &'static str) -> Result<T, LoadError> {
            // SAFETY: T is the signature that `NIDAQmx.h` gives this name, above
            let found = unsafe { library.get::<T>(name) };
            found.map(|symbol| *symbol).map_err(|_| LoadError::Foreign { path: path.to_owned(), function: name })
        }
        Ok(DaqmxLibrary {
            create_task: function(&library, path, "DAQmxCreateTask")?,
            create_ai_voltage_channel: function(&library, path, "DAQmxCreateAIVoltageChan")?,
            configure_sample_clock: function(&library, path, "DAQmxCfgSampClkTiming")?,
            start_task: function(&library, path, "DAQmxStartTask")?,
            stop_task: function(&library, path, "DAQmxStopTask")?,
            clear_task: function(&library, path, "DAQmxClearTask")?,
            read_analog_f64: function(&library, path, "DAQmxReadAnalogF64")?,
            extended_error_info: function(&library, path, "DAQmxGetExtendedErrorInfo")?,
            error_string: function(&library, path, "DAQmxGetErrorString")?,
            _library: library,
        })
    }
}

impl NiDaqmx for DaqmxLibrary {
    fn create_task(&self, name: &str, task: &mut TaskHandle) -> i32 {
        let Ok(name) = CString::new(name) else { return BAD_VALUE };
        let mut handle: NiHandle = std::ptr::null_mut();
        // SAFETY: the name ends with a zero byte, and the handle is written to a place of its type
        let status = unsafe { (self.create_task)(name.as_ptr(), &raw mut handle) };
        *task = handle as TaskHandle;
        status
    }

    fn create_ai_voltage_channel(&self, task: TaskHandle, physical: &str, terminal: i32, range_v: [f64; 2]) -> i32 {
        let Ok(physical) = CString::new(physical) else { return BAD_VALUE };
        let (name, scale) = (c"".as_ptr(), std::ptr::null());
        // SAFETY: all texts end with a zero byte; no custom scale is NULL by the header
        unsafe {
            let create = self.create_ai_voltage_channel;
            create(task as NiHandle, physical.as_ptr(), name, terminal, range_v[0], range_v[1], VOLTS, scale)
        }
    }

    fn configure_sample_clock(&self, task: TaskHandle, rate_hz: f64, samples_per_channel: u64) -> i32 {
        let configure = self.configure_sample_clock;
        // SAFETY: no source is the device's own clock, NULL by the header
        unsafe { configure(task as NiHandle, std::ptr::null(), rate_hz, RISING, CONTINUOUS, samples_per_channel) }
    }

    fn start_task(&self, task: TaskHandle) -> i32 {
        // SAFETY: a handle and nothing else
        unsafe { (self.start_task)(task as NiHandle) }
    }

    fn stop_task(&self, task: TaskHandle) -> i32 {
        // SAFETY: as above
        unsafe { (self.stop_task)(task as NiHandle) }
    }

    fn clear_task(&self, task: TaskHandle) -> i32 {
        // SAFETY: as above
        unsafe { (self.clear_task)(task as NiHandle) }
    }

    fn read_analog_f64(&self, task: TaskHandle, samples_per_channel: i32, buffer: &mut [f64], read: &mut i32) -> i32 {
        let length = u32::try_from(buffer.len()).unwrap_or(u32::MAX);
        let (at_once_s, reserved) = (0.0, std::ptr::null_mut());
        // SAFETY: the buffer has the length that is said, in numbers; `read` is an i32
        unsafe {
            let (take, buffer) = (self.read_analog_f64, buffer.as_mut_ptr());
            take(task as NiHandle, samples_per_channel, at_once_s, BY_SCAN, buffer, length, read, reserved)
        }
    }

    fn extended_error_info(&self) -> String {
        // SAFETY: the buffer has the length that is said
        text(|buffer, length| unsafe { (self.extended_error_info)(buffer, length) })
    }

    fn error_string(&self, code: i32) -> String {
        // SAFETY: as above
        text(|buffer, length| unsafe { (self.error_string)(code, buffer, length) })
    }
}

/// Returns the text that the library writes into a buffer, up to the zero byte.
fn text(write: impl FnOnce(*mut c_char, u32) -> i32) -> String {
    let mut buffer = vec![0u8; TEXT_BYTES];
    write(buffer.as_mut_ptr().cast(), TEXT_BYTES as u32);
    let end = buffer.iter().position(|&byte| byte == 0).unwrap_or(TEXT_BYTES);
    String::from_utf8_lossy(&buffer[..end]).trim().to_owned()
}
