//! Magnetic skins: packages of PyPI read our emulator, and our driver reads a stand-in of their board.
//!
//! Needs `PALPATE_PYTHON`, an interpreter with the packages.
#![cfg(unix)]

use palpate_sim::emulator::lines::REST_MICROTESLA;
use palpate_testing::python::{Python, said};
use palpate_testing::served::ServedProgram;
use palpate_testing::{Live, TestFolder, exchanged, shipped_text};
use serde_json::Value;

/// A rig whose array is a skin of five chips.
fn rig(link: &str) -> String {
    let array = format!(
        "driver = {{ lines = \"reskin\" }}\nlink = \"{link}\"\nplaces_mm = [[0, 0], [-3, -3], [3, -3], [-3, 3], [3, 3]]\n\
         channels_per_unit = 3\nunit = \"uT\"\n"
    );
    let text = shipped_text("rigs/esp301.toml");
    let (before, rest) = text.split_once("[array]\n").expect("an array");
    let (_, after) = rest.split_once("[limits]").expect("limits");
    format!("{before}[array]\n{array}\n[limits]{after}")
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn anyskin_and_reskin_sensor_read_our_board() {
    for (package, module) in [("anyskin", "anyskin.sensor"), ("reskin_sensor", "reskin_sensor.sensor")] {
        let python = Python::with(&format!("import {module}"));
        let simulated = rig("sim").replace("serial:///dev/ttyUSB0?baud=921600", "sim");
        let served = ServedProgram::new(&simulated.replace("serial:///dev/ttyUSB1?baud=115200", "sim"), "");
        let output = said(python.script("skin_client.py", [package, served.address("array")]));
        let means = output.lines().find_map(|line| line.strip_prefix("means ")).expect("means");
        let means: Vec<f64> = means.split(' ').map(|mean| mean.parse().expect("a number")).collect();
        assert_eq!(means.len(), 15, "{output}");
        assert!(means.iter().all(|mean| (mean - REST_MICROTESLA).abs() < 1.0), "without load: {output}");
    }
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn our_driver_reads_a_stand_in_of_their_board() {
    let python = Python::with("import struct, socket");
    let stage = ServedProgram::new(&shipped_text("rigs/sim.toml"), "--port stage=0");
    let board = Live::start(python.script("skin_board.py", ["430.0"]));
    let address = board.line().expect("its address");
    let mut text = rig(&format!("tcp://{address}"));
    for (from, to) in [
        ("serial:///dev/ttyUSB0?baud=921600", format!("tcp://{}", stage.address("stage"))),
        ("serial:///dev/ttyUSB1?baud=115200", format!("serial://{}?baud=115200", stage.address("load_cell"))),
    ] {
        text = exchanged(&text, from, &to);
    }
    let bench = TestFolder::with([("rig.toml", text.as_str())]);
    let output = bench.palpate_ends(1, "doctor rig.toml --json --confirmed down");
    let output: Value = serde_json::from_str(&output.out).expect("one JSON object");
    let identity = output["devices"][2]["identity"]["identity"].as_str().unwrap_or_default();
    assert_eq!(identity, "ReSkin or AnySkin, 5 chips, 15 outputs", "{output}");
}
