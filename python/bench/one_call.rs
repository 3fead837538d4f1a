//! Median time of a call from Rust, ns, for each line on standard input: `one_call MODEL READINGS`. The readings are numbers of
//! eight bytes in a file, little-endian. `solve.py` compares it with a call from Python.

use palpate_data::dataset::sensor_file::read_sensor_file;
use palpate_solver::Session;
use std::env::args_os;
use std::error::Error;
use std::hint::black_box;
use std::io::stdin;
use std::path::PathBuf;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<PathBuf> = args_os().skip(1).map(PathBuf::from).collect();
    let [model, readings] = &paths[..] else { return Err("expected: one_call MODEL READINGS".into()) };
    let (_, model) = read_sensor_file(model)?;
    let bytes = std::fs::read(readings)?;
    let numbers: Vec<f64> = bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let units = model.validity().units;
    let mut session = Session::new(model);
    for line in stdin().lines() {
        line?;
        let spent = numbers.chunks_exact(units).map(|reading| {
            let began = Instant::now();
            let _ = black_box(session.solve(black_box(reading)));
            began.elapsed().as_nanos()
        });
        let mut spent: Vec<u128> = spent.collect();
        spent.sort_unstable();
        println!("{}", spent[spent.len() / 2]);
    }
    Ok(())
}
