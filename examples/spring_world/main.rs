//! A spring world in real time behind the process protocol (docs/reference/process.md): a stage, a load cell, an array and a specimen that
//! know the true force, with faults on demand. palpate's safety is attacked with it; `tests/control/spring_world.rs` does that.
//!
//! ```sh
//! cargo build && cargo run --example spring_world -- run --palpate target/debug/palpate --fault cell-slow:lag=1.2,at-press=3 --seed 7
//! ```
//!
//! runs palpate once and prints a line of JSON. `--keep DIR` keeps the rig, the recipe, the run folder and what palpate said.
//! `--stiffness SHARE` sets the true stiffness as a share of the declared one, `--strategy` and `--presses` the recipe. `kinds`
//! lists the faults. palpate itself starts this program as `stage`, `load_cell` and `array`.
#![allow(clippy::print_stdout, reason = "it prints its results")]

mod axis;
mod devices;
mod faults;
mod run;
mod sensors;
mod setting;
mod world;

use setting::{STRATEGIES, WorldSetting};
use std::env;
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = env::args().skip(1).collect();
    let done = match words.first().map(String::as_str) {
        Some("run") => task(&words[1..]).and_then(run::carry_out).map(|line| println!("{line}")),
        Some("kinds") => {
            kinds();
            Ok(())
        }
        Some(role @ ("stage" | "load_cell" | "array")) => match words.get(1).and_then(|port| port.parse().ok()) {
            Some(port) => devices::client(role, port).map_err(|error| error.to_string()),
            None => Err("a role needs the port of the world".to_owned()),
        },
        _ => Err("run --palpate PROGRAM --fault TEXT --seed N [--keep DIR] [--stiffness SHARE] [--strategy NAME] \
                  [--presses N], or kinds"
            .to_owned()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("spring_world: {error}");
            ExitCode::FAILURE
        }
    }
}

/// One line for each kind: name, parameter, values that a campaign tries, and what it does.
fn kinds() {
    for kind in &faults::KINDS {
        let tried: Vec<String> = kind.tried.iter().map(f64::to_string).collect();
        println!("{}\t{}\t{}\t{}", kind.name, kind.parameter, tried.join(" "), kind.meaning);
    }
}

fn task(words: &[String]) -> Result<run::WorldTask, String> {
    let option = |name: &str| words.iter().position(|word| word == name).and_then(|at| words.get(at + 1));
    let seed = option("--seed").map_or(Ok(1), |seed| seed.parse()).map_err(|_| "--seed takes a whole number")?;
    let share = option("--stiffness").map(|share| share.parse()).transpose();
    let share = share.map_err(|_| "--stiffness takes a number")?;
    let presses = option("--presses").map(|presses| presses.parse()).transpose();
    let presses = presses.map_err(|_| "--presses takes a whole number")?;
    let named = |name: &String| STRATEGIES.into_iter().find(|strategy| strategy == name).ok_or("an unknown strategy");
    let strategy = option("--strategy").map(named).transpose()?;
    Ok(run::WorldTask {
        palpate: option("--palpate").ok_or("--palpate names the program")?.into(),
        fault: option("--fault").map_or("none", String::as_str).to_owned(),
        seed,
        share,
        keep: option("--keep").map(Into::into),
        setting: WorldSetting::new(seed, share, strategy, presses),
    })
}
