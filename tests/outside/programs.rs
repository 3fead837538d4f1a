//! Programs of others use our emulators: PyMeasure, newportxps, Newport's own driver, pymodbus, mbpoll, grbl-streamer,
//! Printrun, OctoPrint, Moonraker, ur_rtde, NetFT, pynetft.
//!
//! Each test needs `PALPATE_PYTHON`, an interpreter with the packages of `tests/outside/requirements.txt`, or the program itself.
#![cfg(unix)]

use palpate_testing::python::{Python, said};
use palpate_testing::served::ServedProgram;
use palpate_testing::{Live, TestFolder, exchanged, shipped, shipped_text, there};
use std::process::Command;
use std::time::Duration;

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn pymeasure_drives_the_esp301_over_a_serial_line() {
    let statement = "import pymeasure, pyvisa_py, serial";
    let python = Python::with(statement);
    let served = ServedProgram::new(&shipped_text("rigs/sim.toml"), "");
    let resource = format!("ASRL{}::INSTR", served.address("stage"));
    assert_eq!(said(python.script("esp300.py", [resource])), "x at 0.250 mm\n");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn pymeasure_drives_the_esp301_over_tcp() {
    let python = Python::with("import pymeasure, pyvisa_py");
    let served = ServedProgram::new(&shipped_text("rigs/sim.toml"), "--port stage=0");
    let [host, port] = served.host_and_port("stage");
    let resource = format!("TCPIP::{host}::{port}::SOCKET");
    assert_eq!(said(python.script("esp300.py", [resource])), "x at 0.250 mm\n");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn newportxps_drives_the_xps() {
    let python = Python::with("import newportxps");
    let served = ServedProgram::new(&shipped_text("rigs/paper.toml"), "");
    let output = said(python.script("newport_xps.py", served.host_and_port("stage")));
    assert!(output.lines().last().is_some_and(|line| line.starts_with("y stopped at ")), "{output}");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn newports_own_driver_drives_the_xps() {
    let statement =
        "import importlib.util as u, numpy; assert u.find_spec('pymodaq_plugins_newport'), 'it is not there'";
    let python = Python::with(statement);
    let served = ServedProgram::new(&shipped_text("rigs/paper.toml"), "");
    let output = said(python.script("vendor_xps.py", served.host_and_port("stage")));
    assert_eq!(output, "x at 1.250 mm\n");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn pymodbus_asks_the_labjack_over_tcp() {
    let python = Python::with("import pymodbus");
    let served = ServedProgram::new(&shipped_text("rigs/sim.toml"), "");
    let [host, port] = served.host_and_port("array");
    let volts = said(python.script("modbus_client.py", ["t7", host, port]));
    assert!(volts.trim().parse::<f64>().is_ok_and(|volts| volts < 0.1), "{volts}");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn pymodbus_asks_every_transmitter_over_a_serial_line() {
    let python = Python::with("import pymodbus, serial");
    for (script, map) in
        [("rs485", "generic-rs485"), ("tlb", "laumas-tlb"), ("zsg", "seneca-zsg"), ("zsg2", "seneca-zsg2")]
    {
        let served = ServedProgram::new(&with_cell(map), "");
        said(python.script("modbus_client.py", [script, served.address("load_cell")]));
    }
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn netft_and_pynetft_read_the_net_ft() {
    let python = Python::with("import NetFT, pynetft");
    let cell = "{ lines = \"ati-netft\" }\naxes = { x = \"y\", y = \"-x\", press = \"-z\" }\n#";
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "{ modbus = \"generic-rs485\" }", cell);
    let rig = exchanged(&rig, "noise_n = 0.003", "noise_n = 0.003, offset_n = 0.3");
    // NetFT has the port 49152 fixed: hence an address of its own
    let served = ServedProgram::new(&rig, "--listen 127.0.0.3 --port load_cell=49152");
    for package in ["NetFT", "pynetft"] {
        let [host, port] = served.host_and_port("load_cell");
        let output = said(python.script("net_ft.py", [package, host, port]));
        let means: Vec<f64> = output.split_whitespace().filter_map(|mean| mean.parse().ok()).collect();
        let is_near = means.iter().zip([0.0, 0.0, -0.3]).all(|(mean, force_n)| (mean - force_n).abs() < 0.002);
        assert!(means.len() == 3 && is_near, "{package}: {output}");
    }
}

#[test]
#[ignore = "needs mbpoll"]
fn mbpoll_asks_the_labjack_over_tcp() {
    let served = ServedProgram::new(&shipped_text("rigs/sim.toml"), "");
    let [host, port] = served.host_and_port("array");
    let ask = |words: &str| mbpoll(&format!("-m tcp -p {port} {words}"), host);
    for unit in [1, 17] {
        for function in [3, 4] {
            // PRODUCT_ID and TEST: both word orders, in both kinds of registers, for any unit ID
            let words = format!("-a {unit} -t {function}:float -B -r 60000");
            assert_eq!(ask(&words), Ok(vec!["7".into()]), "{words}");
        }
    }
    assert_eq!(ask("-t 4:hex -r 55100 -c 2"), Ok(vec!["0x0011".into(), "0x2233".into()]));
    assert_eq!(ask("-t 4:int -r 55100"), Ok(vec![0x2233_0011.to_string()]), "the low word first");
    let volts = ask("-t 3:float -B -r 0 -c 14").expect("all inputs");
    assert_eq!(volts.len(), 14);
    assert!(volts.iter().all(|volts| volts.parse::<f64>().is_ok_and(|volts| volts.abs() < 0.1)), "{volts:?}");
    refuses(ask("-t 0 -r 0 -c 1"), "Illegal function");
    refuses(ask("-t 4 -r 30000 -c 1"), "Illegal data address");
    refuses(ask("-t 4 -r 0 -c 3"), "Illegal data value");
}

#[test]
#[ignore = "needs mbpoll"]
fn mbpoll_asks_the_transmitter_over_a_serial_line() {
    let served = ServedProgram::new(&with_cell("generic-rs485"), "");
    let ask = |words: &str| mbpoll(&format!("-m rtu -b 9600 -P none -a 1 {words}"), served.address("load_cell"));
    let gross = ask("-t 4:int -B -r 80").expect("a weight");
    assert!(gross[0].parse::<i32>().is_ok_and(|counts| counts.abs() < 100), "{gross:?}");
    assert_eq!(ask("-t 4:hex -r 0 -c 100").expect("the whole map").len(), 100);
    refuses(ask("-t 0 -r 0 -c 1"), "Illegal function");
    refuses(ask("-t 4 -r 99 -c 2"), "Illegal data address");
    // a request for another unit ID isn't answered
    refuses(ask("-a 2 -o 0.3 -t 4 -r 8"), "Connection timed out");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn grbl_streamer_drives_the_grbl() {
    let python = Python::with("import grbl_streamer");
    let served = ServedProgram::new(&shipped_text("rigs/grbl.toml"), "");
    let output = said(python.script("grbl.py", [served.address("stage")]));
    assert!(output.starts_with("x at "), "{output}");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn printcore_drives_the_marlin() {
    let python = Python::with("import printrun.printcore");
    let served = ServedProgram::new(&shipped_text("rigs/marlin.toml"), "");
    let output = said(python.script("printcore.py", [served.address("stage")]));
    assert_eq!(output, "FIRMWARE_NAME:Marlin 2.1.2\n");
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn ur_rtde_reads_the_arm() {
    let python = Python::with("import rtde_receive, dashboard_client");
    // its ports are fixed, so the robot has an address of its own
    let host = "127.0.42.42";
    let _served = ServedProgram::new(&shipped_text("rigs/ur.toml"), &format!("--listen {host} --port stage=30004"));
    assert_eq!(said(python.script("ur_rtde.py", [host])), "UR5 at 301.3 -200.8 105.0 mm\n");
}

/// It counts, acknowledges and refuses lines in its own way, and moves in no time: so z only goes away, line by line.
#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn octoprints_virtual_printer_is_retracted() {
    let python = Python::with("import serial");
    let rig = shipped_text("rigs/marlin.toml");
    let rig = exchanged(
        &rig,
        "step_mm = { x = 0.0125, y = 0.0125, z = 0.0025 }",
        "step_mm = { x = 0.01, y = 0.01, z = 0.01 }",
    );
    let rig = exchanged(&rig, "acceleration_mm_s2 = 100.0", "acceleration_mm_s2 = 10.0");
    for error in ["resend", "resend_with_timeout", "missing_lineno", "checksum_mismatch"] {
        let bench = TestFolder::new();
        let printer =
            Live::start(python.script("virtual_printer.py", [bench.path(""), format!("1030:{error}").into()]));
        let line = printer.line().expect("it starts");
        let port = line.strip_prefix("printer at ").expect("its terminal");
        std::fs::write(bench.path("rig.toml"), exchanged(&rig, "/dev/ttyUSB0", port)).expect("a file");
        let output = said(bench.command("retract rig.toml --confirmed down"));
        assert!(output.contains("z is at 3.600 mm of the stage, away from the specimen"), "{error}: {output}");
        // a line without a number isn't asked for again
        assert_eq!(printer.line_within(Duration::ZERO).is_ok(), error != "missing_lineno", "{error}");
    }
}

/// Moonraker stands between the driver and a socket that answers as Klipper's.
#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn a_printer_behind_moonraker_presses() {
    let python = Python::with("import moonraker, inotify_simple");
    let spring = shipped("tests/outside/printer_bench.py").display().to_string();
    let bench = TestFolder::with([("r.toml", ONE_PRESS)]);
    std::fs::write(bench.path("tip"), 1e3f64.to_le_bytes()).expect("a file");
    let printer = Live::start(python.script("klippy.py", [bench.path("")]));
    let address = loop {
        let line = printer.line().expect("Moonraker starts");
        if let Some(address) = line.strip_prefix("printer at ") {
            break address.to_owned();
        }
    };
    let role = |name: &str| format!("driver = {{ process = [\"python3\", {spring:?}, \".\", \"{name}\"] }}");
    let rig = shipped_text("rigs/klipper.toml");
    let rig = exchanged(&rig, "192.168.1.30:7125", &address);
    let rig = exchanged(&rig, "z = -10.0, uncertainty", "z = -5.0, uncertainty");
    let rig = exchanged(
        &rig,
        "driver = { lines = \"hx711\", newton_per_unit = 0.0000025, offset = 84000.0 }\nlink = \"serial:///dev/ttyACM0?baud=115200\"",
        &role("load_cell"),
    );
    let rig =
        exchanged(&rig, "driver = { modbus = \"labjack-t7\" }\nlink = \"tcp://192.168.1.10:502\"", &role("array"));
    std::fs::write(bench.path("rig.toml"), rig).expect("a file");
    said(bench.command("run r.toml --rig rig.toml --confirmed down --confirmed home --out run"));
    let number = |text: String| text.trim().parse::<f64>().expect("a number");
    let force_n = number(bench.column("run/presses.csv", "force_n").remove(0));
    assert!((force_n - 0.5).abs() < 0.05, "{force_n} N");
    let peak_n = number(bench.read("peak"));
    assert!(peak_n < 0.55, "{peak_n} N");
}

const ONE_PRESS: &str = "name = \"one\"\nchecks = \"none\"\n[press]\nstrategy = \"guarded\"\n[[step]]\nphase = \"calibration\"\n\
                         grid = { x_mm = [0.0, 0.0], y_mm = [0.0, 0.0], spacing_mm = 1.0 }\nforce_n = 0.5\n";

#[test]
#[ignore = "needs python3"]
fn the_examples_are_devices_of_a_rig() {
    has_python3();
    let arm =
        exchanged(&shipped_text("rigs/process.toml"), "examples/stage.py\"]", "examples/arm.py\"], finishes = true");
    let bench = TestFolder::with([("arm.toml", arm.as_str())]);
    let arm = bench.path("arm.toml").display().to_string();
    for (rig, stage) in [("rigs/process.toml", "stage"), (&arm, "arm")] {
        let mut command = bench.command(&format!("doctor {rig} --json --confirmed down"));
        command.current_dir(shipped(""));
        let output = command.output().expect("the program starts");
        // nothing has shown that the load cell measures force
        assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
        let printed: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let identity = |device: usize| printed["devices"][device]["identity"]["identity"].as_str().unwrap_or_default();
        for (device, name) in [stage, "load cell", "array"].iter().enumerate() {
            assert!(identity(device).contains(name), "{printed}");
        }
        assert!(printed["noise_n"].as_f64().is_some_and(|noise_n| noise_n > 0.0), "{printed}");
    }
}

#[test]
#[ignore = "needs python3"]
fn a_printer_behind_a_real_process_presses() {
    has_python3();
    let script = shipped("tests/outside/printer_bench.py");
    let command = |role: &str| format!("[\"python3\", {:?}, \".\", \"{role}\"]", script.display().to_string());
    let rig = shipped_text("rigs/printer.toml");
    let rig = exchanged(&rig, r#"["python3", "examples/printer.py"]"#, &command("stage"));
    let rig = exchanged(&rig, r#"["python3", "examples/load_cell.py"]"#, &command("load_cell"));
    let rig = exchanged(&rig, r#"["python3", "examples/array.py", "9"]"#, &command("array"));
    // a short way down makes the test short
    let rig = exchanged(&rig, "z = [0.0, 25.0]", "z = [0.0, 11.5]");
    let recipe = "name = \"few\"\n[press]\nstrategy = \"guarded\"\n[[step]]\nphase = \"calibration\"\n\
                  grid = { x_mm = [-1.0, 1.0], y_mm = [-1.0, 1.0], spacing_mm = 2.0 }\nforce_n = 0.5\n";
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", recipe)]);
    std::fs::write(bench.path("tip"), 1e3f64.to_le_bytes()).expect("a file");
    said(bench.command("run r.toml --rig rig.toml --confirmed down --out run"));
    let number = |text: String| text.trim().parse::<f64>().expect("a number");
    let forces: Vec<f64> = bench.column("run/presses.csv", "force_n").into_iter().map(number).collect();
    assert!(forces.len() == 4 && forces.iter().all(|force_n| (force_n - 0.5).abs() < 0.05), "{forces:?}");
    let peak_n = number(bench.read("peak"));
    assert!(peak_n < 0.55, "{peak_n} N");
}

/// The simulated rig with another transmitter.
fn with_cell(map: &str) -> String {
    exchanged(&shipped_text("rigs/sim.toml"), "\"generic-rs485\"", &format!("\"{map}\""))
}

fn has_python3() {
    there(Command::new("python3").arg("--version"), "python3");
}

/// One read by mbpoll: the values or the error.
fn mbpoll(words: &str, device: &str) -> Result<Vec<String>, String> {
    let mut command = Command::new("mbpoll");
    let output = there(command.args(["-0", "-1", "-q"]).args(words.split_whitespace()).arg(device), "mbpoll");
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    if !output.status.success() {
        return Err(text(&output.stderr) + &text(&output.stdout));
    }
    // [60000]: 	7
    let values = text(&output.stdout);
    let value = |line: &str| Some(line.strip_prefix('[')?.split_once(':')?.1.split_whitespace().next()?.to_owned());
    Ok(values.lines().filter_map(value).collect())
}

fn refuses(answer: Result<Vec<String>, String>, output: &str) {
    let error = answer.expect_err("an exception");
    assert!(error.contains(output), "{error}");
}
