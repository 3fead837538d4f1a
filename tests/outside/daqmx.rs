//! NI's library as it is loaded: a stub of it in C (`tests/outside/daqmx/stub.c`) behind the real `dlopen`, on the real clock.
//!
//! Needs a C compiler (`cc`); the test with nidaqmx-python needs `PALPATE_PYTHON` too.
#![cfg(target_os = "linux")]

use palpate_drivers::daqmx::{
    Acquisition, DaqmxArray, DaqmxLoadCell, Inputs, Sensitivity, SharedAcquisition, Terminal,
};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell, SensorArray};
use palpate_link::time::{Instant, timeout};
use palpate_link::wire::daqmx::{AUTO, DaqmxLibrary, Functions, LoadError, NiDaqmx, RSE};
use palpate_testing::python::{Python, said};
use palpate_testing::served::ServedProgram;
use palpate_testing::{TestFolder, exchanged, shared_library, shipped_text, there};
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Mutex;

/// Longest wait for samples at 1 kHz.
const PATIENCE: Duration = Duration::from_secs(5);
const RATE_HZ: f64 = 1000.0;
/// Messages of the stub.
const UNKNOWN_DEVICE: &str =
    "error -200220: Device identifier is invalid.\n\nDevice Specified: Dev7\n\nStatus Code: -200220";
const OVERRUN: &str = "error -200279: The application is not able to keep up with the hardware acquisition.\n\nStatus \
                       Code: -200279";

/// The stub, built with additional messages.
fn stub(bench: &TestFolder, words: &[&str]) -> PathBuf {
    let words: Vec<&str> = words.iter().copied().chain(["-Wl,-soname,libnidaqmx.so"]).collect();
    shared_library(bench, "libnidaqmx.so", "tests/outside/daqmx/stub.c", &words)
}

fn load(path: &std::path::Path) -> Result<DaqmxLibrary, LoadError> {
    DaqmxLibrary::load(Some(path.to_str().expect("a path in UTF-8")))
}

fn inputs(physical: &str, count: usize) -> Inputs {
    Inputs { physical: physical.to_owned(), count, terminal: Terminal::Rse, range_v: 10.0 }
}

fn acquisition(library: DaqmxLibrary, inputs: Vec<Inputs>) -> Acquisition {
    let functions = Functions::on_a_thread(Arc::new(library)).expect("a thread");
    Acquisition::new(functions, inputs, RATE_HZ, "daqmx".to_owned())
}

fn refused(result: Result<(), DeviceError>) -> String {
    match result.expect_err("an error").problem {
        DeviceProblem::Refused(output) => output.trim_start_matches("it reports: ").to_owned(),
        other => panic!("{other}"),
    }
}

#[tokio::test]
#[ignore = "needs a C compiler: cc"]
async fn loaded_library_delivers_all_samples_in_order() {
    let bench = TestFolder::new();
    let path = stub(&bench, &[]);
    let library = load(&path).expect("the library");
    let mut task = 0;
    assert_eq!(library.create_task("", &mut task), 0);
    assert_eq!(library.create_ai_voltage_channel(task, "Dev1/ai2:4", RSE, [-10.0, 10.0]), 0);
    assert_eq!(library.configure_sample_clock(task, RATE_HZ, 10_000), 0);
    let began = Instant::now();
    assert_eq!(library.start_task(task), 0);
    let (mut scans, mut buffer) = (0, vec![f64::NAN; 3 * 100]);
    while scans < 150 {
        let mut read = -1;
        assert_eq!(library.read_analog_f64(task, AUTO, &mut buffer, &mut read), 0);
        for (n, scan) in buffer.chunks(3).take(read as usize).enumerate() {
            let ramp_v = 1e-3 * (scans + n) as f64;
            assert_eq!(scan, [2.0 + ramp_v, 3.0 + ramp_v, 4.0 + ramp_v], "scan {}", scans + n);
        }
        scans += read as usize;
        assert!(began.elapsed() < PATIENCE, "{scans} scans");
    }
    assert!(began.elapsed().as_secs_f64() >= 0.15, "faster than they are sampled");
    let mut read = -1;
    assert_eq!(library.read_analog_f64(task, 1000, &mut buffer, &mut read), -200_284);
    assert!(library.extended_error_info().ends_with("Status Code: -200284"), "{}", library.extended_error_info());
    assert_eq!(library.error_string(-200_284), "Status code -200284");
    assert_eq!((library.stop_task(task), library.clear_task(task)), (0, 0));
}

#[tokio::test]
#[ignore = "needs a C compiler: cc"]
async fn a_load_cell_and_an_array_read_one_task_on_the_librarys_thread() {
    let bench = TestFolder::new();
    let path = stub(&bench, &[]);
    let both = vec![inputs("Dev1/ai0", 1), inputs("Dev1/ai1:9", 9)];
    let shared: SharedAcquisition = Arc::new(Mutex::new(acquisition(load(&path).expect("the library"), both)));
    let identity = |role: &str| Identity {
        role: role.to_owned(),
        identity: "NI-DAQmx".to_owned(),
        link: "daqmx".to_owned(),
        warnings: Vec::new(),
    };
    let origin = Instant::now();
    let mut cell =
        DaqmxLoadCell::new(shared.clone(), 0, Sensitivity::OneAxis(2.0), 10.0, RATE_HZ, origin, identity("load_cell"));
    let mut array = DaqmxArray::new(shared, 1, 9, identity("array"));
    let execute = async {
        assert_eq!(cell.prepare().await.expect("a cell").role, "load_cell");
        assert_eq!(array.prepare().await.expect("an array").role, "array");
        let mut last_n = 0.0;
        for _ in 0..20 {
            let reading = cell.read().await.expect("a force");
            // the ramp, at 2 N a volt: each scan is read once
            assert!(reading.force_n > last_n && !reading.health.saturated, "{reading:?} after {last_n} N");
            let late_s = reading.at_s - reading.force_n / 2.0;
            assert!((0.0..1.0).contains(&late_s), "scan of {} s told at {} s", reading.force_n / 2.0, reading.at_s);
            last_n = reading.force_n;
            let mut outputs = [f64::NAN; 9];
            array.read(&mut outputs).await.expect("outputs");
            let ramp_v = outputs[0] - 1.0;
            assert!(ramp_v >= last_n / 2.0 - 1e-9, "{outputs:?}");
            for (n, output) in outputs.iter().enumerate() {
                assert!((output - ramp_v - (n + 1) as f64).abs() < 1e-9, "{outputs:?}");
            }
        }
    };
    timeout(PATIENCE, execute).await.expect("in time");
}

#[tokio::test]
#[ignore = "needs a C compiler: cc"]
async fn library_refusals_keep_their_text() {
    let bench = TestFolder::new();
    let path = stub(&bench, &[]);
    let mut unknown = acquisition(load(&path).expect("the library"), vec![inputs("Dev7/ai0", 1)]);
    assert_eq!(refused(unknown.prepare().await), UNKNOWN_DEVICE);
    let mut lost = acquisition(load(&path).expect("the library"), vec![inputs("Lost1/ai0:3", 4)]);
    lost.prepare().await.expect("a task");
    assert_eq!(refused(lost.after(0).await), OVERRUN);
    assert!(lost.after(0).await.is_err_and(|error| error.to_string().ends_with("its task isn't running")));
    lost.prepare().await.expect("a task anew");
}

#[test]
fn missing_library_is_named() {
    let missing = TestFolder::new().path("none.so");
    let error = load(&missing).err().expect("no library").to_string();
    assert!(error.contains("NI's DAQmx library wasn't found on this machine") && error.contains("none.so"), "{error}");
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn a_library_that_lacks_a_function_is_named() {
    let bench = TestFolder::new();
    let path = stub(&bench, &["-DLACKS_STOP"]);
    let error = load(&path).err().expect("not this library").to_string();
    assert_eq!(error, format!("{} isn't NI's DAQmx library: it has no function DAQmxStopTask", path.display()));
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn doctor_meets_a_rigs_own_library() {
    let bench = TestFolder::new();
    let path = stub(&bench, &[]);
    let served = ServedProgram::new(&shipped_text("rigs/sim.toml"), "--port stage=0");
    let link = format!("daqmx://{}", path.display());
    let mut rig = shipped_text("rigs/esp301.toml");
    for (from, to) in [
        ("serial:///dev/ttyUSB0?baud=921600", format!("tcp://{}", served.address("stage")).as_str()),
        ("{ modbus = \"generic-rs485\" }", "{ daqmx = \"Dev7/ai0\", newton_per_volt = 1.0 }"),
        ("serial:///dev/ttyUSB1?baud=115200", &link),
        ("{ modbus = \"labjack-t7\" }", "{ daqmx = \"Dev1/ai1:9\" }"),
        ("tcp://192.168.1.10:502", &link),
    ] {
        rig = exchanged(&rig, from, to);
    }
    bench.write("rig.toml", &rig);
    let output = bench.palpate_ends(3, "doctor rig.toml");
    assert!(output.running().contains("error -200220: Device identifier is invalid."), "{}", output.err);
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt), cc and objdump"]
fn nidaqmx_python_reads_the_same_numbers_of_the_same_stub() {
    let python = Python::with("import nidaqmx");
    // with LD_LIBRARY_PATH alone, Python finds a library by asking the linker and objdump
    there(Command::new("objdump").arg("--version"), "objdump (binutils)");
    let bench = TestFolder::new();
    let path = stub(&bench, &[]);
    let mut command = python.script("nidaqmx_stub.py", [&path]);
    command.env("LD_LIBRARY_PATH", path.parent().expect("a folder"));
    let output = said(command);
    let scans = "[[2.0, 3.0, 4.0], [2.001, 3.001, 4.001], [2.002, 3.002, 4.002]]";
    let text = |error: &'static str| error.split_once(": ").expect("a code and a text").1;
    assert_eq!(output, format!("{scans}\n{}\n{}\n", text(UNKNOWN_DEVICE), text(OVERRUN)));
}
