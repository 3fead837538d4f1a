//! Calibrates a simulated sensor, and solves one contact: `cargo run --example calibrate`.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use palpate::api::{self, Failure, MethodOptions, RunOptions, SensorModel};
use palpate_run::run::Listener;
use palpate_solver::Session;

/// Prints each press when it is on disk.
struct PrintPresses;

impl Listener for PrintPresses {
    fn recorded(&mut self, contact: &palpate_data::dataset::RecordedContact) {
        let press = &contact.levels[0];
        println!("press {}: {:.2}, {:.2} mm", press.press, press.x_mm, press.y_mm);
    }
}

fn main() -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("palpate-example-{}", std::process::id()));
    let options = RunOptions { recipe: "data/example/short.toml".into(), out: Some(folder), ..RunOptions::default() };
    let (run, _) = api::run(&options, &mut PrintPresses)?;
    let method = MethodOptions { solver: "surrogate".to_owned(), ..MethodOptions::default() };
    let sensor = api::fit(&run, &method, &|line| eprintln!("{line}"))?;
    let reading = [0.534, 0.102, 0.021, 0.381, 0.088, 0.021, 0.046, 0.055, 0.027];
    let SensorModel::Contact(model) = sensor.model else { unreachable!("force vectors are an option of the method") };
    match Session::new(*model).solve(&reading) {
        Ok(contact) => println!("{:.2}, {:.2} mm, {:.3} N", contact.place.x_mm, contact.place.y_mm, contact.force_n),
        Err(why) => println!("no contact: {why}"),
    }
    Ok(())
}
