//! Round trips of `palpate serve` against a bare echo, from one client at 1 kHz: `cargo bench --bench serve`.
//!
//! It measures and prints; it doesn't judge. Each millisecond sends one reading to the server and the same line to the echo, in
//! alternating order, so both meet the same disturbances.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use palpate_core::quantity::percentile;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

const READINGS: usize = 10_000;
const PERIOD: Duration = Duration::from_millis(1);
const PALPATE: &str = env!("CARGO_BIN_EXE_palpate");

/// A connection that sends a line and waits for one.
struct Client {
    lines: BufReader<TcpStream>,
    line: String,
}

impl Client {
    fn connect(address: &str) -> Client {
        let stream = TcpStream::connect(address).expect("it listens");
        stream.set_nodelay(true).expect("a socket");
        Client { lines: BufReader::new(stream), line: String::new() }
    }

    fn round_trip_us(&mut self, line: &str) -> f64 {
        let began = Instant::now();
        self.lines.get_mut().write_all(line.as_bytes()).expect("it reads");
        self.line.clear();
        self.lines.read_line(&mut self.line).expect("it answers");
        1e6 * began.elapsed().as_secs_f64()
    }
}

fn echo() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("an address").to_string();
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            stream.set_nodelay(true).expect("a socket");
            let mut answers = stream.try_clone().expect("a socket");
            for line in BufReader::new(stream).lines().map_while(Result::ok) {
                answers.write_all((line + "\n").as_bytes()).expect("a client that reads");
            }
        }
    });
    address
}

fn server(folder: &std::path::Path, method: &str) -> (Child, String) {
    let run = |words: &[&str]| {
        let status =
            Command::new(PALPATE).args(words).current_dir(folder).stderr(Stdio::null()).stdout(Stdio::null()).status();
        assert!(status.expect("the program starts").success(), "{words:?}");
    };
    if !folder.join("run").exists() {
        run(&["run", "paper", "--out", "run"]);
    }
    let model = format!("{method}.palpate");
    run(&["fit", "run", "--solver", method, "--out", &model]);
    let mut child = Command::new(PALPATE)
        .args(["serve", "--model", &model, "--listen", "127.0.0.1:0", "--quiet", "--json"])
        .current_dir(folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
    (child, line.trim().trim_start_matches("listening at ").to_owned())
}

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    let echo = echo();
    println!("round trips at 1 kHz, us: half of them, 99 % and 99.9 % are within");
    for method in ["pearson", "surrogate"] {
        let (mut child, address) = server(folder.path(), method);
        let mut clients = [Client::connect(&address), Client::connect(&echo)];
        let mut times = [Vec::new(), Vec::new()];
        let began = Instant::now();
        for reading in 0..READINGS {
            let output = |unit: usize| 0.2 + ((reading * 31 + unit * 17) % 97) as f64 / 100.0;
            let outputs: Vec<String> = (0..9).map(|unit| output(unit).to_string()).collect();
            let line = format!("[{}]\n", outputs.join(","));
            for turn in 0..2 {
                let which = (reading + turn) % 2;
                times[which].push(clients[which].round_trip_us(&line));
            }
            // the bench measures the rate of the readings
            thread::sleep((PERIOD * reading as u32).saturating_sub(began.elapsed()));
        }
        child.kill().expect("it runs");
        child.wait().expect("it ends");
        let mut at_99 = [0.0; 2];
        for ((name, times), at_99) in [method, "echo"].into_iter().zip(&mut times).zip(&mut at_99) {
            times.sort_by(f64::total_cmp);
            let [half, most, nearly_all] = [0.5, 0.99, 0.999].map(|share| percentile(times, share));
            println!("  {name:<10} {half:>8.1} {most:>8.1} {nearly_all:>8.1}");
            *at_99 = most;
        }
        println!("  {method} / echo at 99 %: {:.2}", at_99[0] / at_99[1]);
    }
}
