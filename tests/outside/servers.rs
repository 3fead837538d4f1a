//! Our drivers read devices that other programs serve: load cells of pymodbus, over TCP and over a pseudo-terminal.
//!
//! Needs `PALPATE_PYTHON`, an interpreter with the packages of `tests/outside/requirements.txt`.
#![cfg(unix)]

use palpate_testing::python::Python;
use palpate_testing::served::ServedProgram;
use palpate_testing::{Live, TestFolder, exchanged, shipped_text};
use serde_json::Value;

/// Output of the server's script: the middle of its forces, and their largest deviation from it.
const FORCE_N: f64 = 0.250;
const SPREAD_N: f64 = 0.002;

/// The user's own map, with the other word order.
const SWAPPED: &str = "name = \"swapped transmitter\"\ntransport = \"tcp\"\nunit_id = 1\ndeadline_ms = 500\n[force]\naddress \
                       = 26\ntype = \"f32\"\nword_order = \"little\"\nnewton_per_unit = 1.0\n";

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn a_load_cell_served_over_tcp() {
    let python = Python::with("import pymodbus");
    let stage = stage();
    for (map, driver) in [("transmitter", "generic-rs485"), ("t7", "labjack-t7"), ("swapped", "swapped.toml")] {
        let server = Live::start(python.script("modbus_server.py", ["tcp", map]));
        let address = server.line().expect("its address");
        examined(&stage, driver, &format!("tcp://{address}"));
    }
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn a_load_cell_served_over_a_serial_line() {
    let python = Python::with("import pymodbus, serial");
    let server = Live::start(python.script("modbus_server.py", ["rtu", "transmitter"]));
    let address = server.line().expect("its address");
    examined(&stage(), "generic-rs485", &format!("serial://{address}?baud=115200"));
}

/// It lacks the registers of the map's probe.
#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn a_served_device_that_isnt_what_the_map_says_is_refused() {
    let python = Python::with("import pymodbus");
    let server = Live::start(python.script("modbus_server.py", ["tcp", "swapped"]));
    let bench = bench(&stage(), "labjack-t7", &format!("tcp://{}", server.line().expect("its address")));
    let output = bench.palpate_ends(3, "doctor rig.toml --json --confirmed down");
    let error = output.json_lines()[0]["devices"][1]["error"].as_str().unwrap_or_default().to_owned();
    assert!(error.contains("PRODUCT_ID"), "{error}");
}

/// An ESP301 and an array of ours, on TCP.
fn stage() -> ServedProgram {
    ServedProgram::new(&shipped_text("rigs/sim.toml"), "--port stage=0")
}

/// A folder with a rig whose load cell is elsewhere.
fn bench(served: &ServedProgram, driver: &str, load_cell: &str) -> TestFolder {
    let mut rig = shipped_text("rigs/esp301.toml");
    for (from, to) in [
        ("serial:///dev/ttyUSB0?baud=921600", format!("tcp://{}", served.address("stage")).as_str()),
        ("serial:///dev/ttyUSB1?baud=115200", load_cell),
        ("tcp://192.168.1.10:502", &format!("tcp://{}", served.address("array"))),
        ("generic-rs485", driver),
    ] {
        rig = exchanged(&rig, from, to);
    }
    TestFolder::with([("rig.toml", rig.as_str()), ("swapped.toml", SWAPPED)])
}

/// Result of doctor: three devices, and the served force.
fn examined(served: &ServedProgram, driver: &str, load_cell: &str) {
    let output = bench(served, driver, load_cell).palpate_ends(1, "doctor rig.toml --json --confirmed down");
    let output: Value = serde_json::from_str(&output.out).expect("one JSON object");
    let identity = |device: usize, key: &str| output["devices"][device]["identity"][key].as_str().unwrap_or_default();
    assert!(identity(0, "identity").contains("ESP301 Version"), "{output}");
    let name = match driver {
        "labjack-t7" => "LabJack T7",
        "generic-rs485" => "generic RS485 load-cell transmitter",
        _ => "swapped transmitter",
    };
    assert!(identity(1, "identity").contains(name), "{output}");
    assert_eq!(identity(1, "link"), load_cell);
    let number = |key: &str| output[key].as_f64().unwrap_or(f64::NAN);
    assert!((number("zero_n") - FORCE_N).abs() < SPREAD_N, "{driver}: {output}");
    assert!((0.1 * SPREAD_N..SPREAD_N).contains(&number("noise_n")), "{driver}: {output}");
}
