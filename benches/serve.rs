//! Round trips of `palpate solve` in a pipe and of `palpate serve`, beside a bare echo, at 1 kHz: `cargo bench --bench serve`.
//!
//! It measures and prints; it doesn't judge. Each millisecond sends one reading to the program and the same line to the echo, in
//! alternating order, so both meet the same disturbances. Each reading is a new contact. `PALPATE_BENCH` chooses by a part of a line.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use palpate_core::quantity::percentile;
use palpate_testing::skins::GridSkin;
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Columns and rows of units, presses along x and y, method.
const SENSORS: [([usize; 2], [usize; 2], &str); 4] = [
    ([3, 3], [25, 25], "pearson"),
    ([3, 3], [25, 25], "surrogate"),
    ([8, 8], [40, 25], "pearson"),
    ([16, 12], [50, 40], "pearson"),
];
const READINGS: usize = 10_000;
const PERIOD: Duration = Duration::from_millis(1);
const PALPATE: &str = env!("CARGO_BIN_EXE_palpate");
/// Line from which an output is broken.
const BROKEN_FROM: usize = 200;
/// Change of all outputs in another session, at most.
const GAINS: f64 = 0.05;

/// A far end that answers each line with a line.
struct Peer {
    answers: Box<dyn BufRead>,
    lines: Box<dyn Write>,
    line: String,
    program: Option<Child>,
}

impl Peer {
    /// Standard input and output of a program.
    fn pipe(program: &str, words: &[&str], folder: &Path) -> Peer {
        let mut child = started(program, words, folder);
        let (answers, lines) = (child.stdout.take().expect("piped"), child.stdin.take().expect("piped"));
        Peer::of(answers, lines, Some(child))
    }

    fn socket(address: &str, program: Option<Child>) -> Peer {
        let stream = TcpStream::connect(address).expect("it listens");
        stream.set_nodelay(true).expect("a socket");
        Peer::of(stream.try_clone().expect("a socket"), stream, program)
    }

    fn of(answers: impl Read + 'static, lines: impl Write + 'static, program: Option<Child>) -> Peer {
        Peer { answers: Box::new(BufReader::new(answers)), lines: Box::new(lines), line: String::new(), program }
    }

    fn round_trip_us(&mut self, line: &str) -> f64 {
        let began = Instant::now();
        self.lines.write_all(line.as_bytes()).expect("it reads");
        self.line.clear();
        self.answers.read_line(&mut self.line).expect("it answers");
        1e6 * began.elapsed().as_secs_f64()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        if let Some(program) = &mut self.program {
            _ = program.kill();
            _ = program.wait();
        }
    }
}

fn main() {
    let chosen = std::env::var("PALPATE_BENCH").unwrap_or_default();
    let folder = tempfile::tempdir().expect("a folder");
    let echo = echo();
    println!("round trips at 1 kHz, us: half of them, 99 % and the longest; in brackets those of the echo");
    for (units, presses, method) in SENSORS {
        let name = format!("{} units, {method}", units[0] * units[1]);
        let mut skin = GridSkin::new(units[0], units[1]);
        write_table(folder.path(), &skin.grid(presses[0], presses[1]));
        run(folder.path(), &["fit", "table.csv", "--solver", method, "--out", "sensor.palpate"]);
        let fresh: Vec<Vec<f64>> = skin.random(READINGS).into_iter().map(|(_, _, outputs)| outputs).collect();
        for stream in ["healthy", "broken", "another session"] {
            let lines: Vec<String> = fresh.iter().enumerate().map(|(index, row)| line(stream, index, row)).collect();
            for link in ["pipe", "TCP"] {
                let name = format!("{name}, {stream}, {link}");
                if name.contains(&chosen) {
                    let peers = match link {
                        "pipe" => [
                            Peer::pipe(
                                PALPATE,
                                &["solve", "--model", "sensor.palpate", "--quiet", "--json"],
                                folder.path(),
                            ),
                            Peer::pipe("cat", &[], folder.path()),
                        ],
                        _ => [server(folder.path()), Peer::socket(&echo, None)],
                    };
                    print_round_trips(&name, peers, &lines);
                }
            }
        }
    }
}

/// A reading of a stream as a line.
fn line(stream: &str, index: usize, row: &[f64]) -> String {
    let middle = row.len() / 2;
    let mut line = "[".to_owned();
    for (unit, output) in row.iter().enumerate() {
        let factor = match stream {
            "broken" if unit == middle && index >= BROKEN_FROM => 0.3,
            "another session" => 1.0 + GAINS * ((unit * 7919 % 201) as f64 / 100.0 - 1.0),
            _ => 1.0,
        };
        let comma = if unit == 0 { "" } else { "," };
        write!(line, "{comma}{:.6}", factor * output).expect("a string takes all");
    }
    line + "]\n"
}

fn print_round_trips(name: &str, mut peers: [Peer; 2], lines: &[String]) {
    let mut times = [Vec::new(), Vec::new()];
    // the first line waits until the program has read its sensor file
    peers.iter_mut().for_each(|peer| _ = peer.round_trip_us(&lines[0]));
    let began = Instant::now();
    for (index, line) in lines.iter().enumerate() {
        for turn in 0..2 {
            let which = (index + turn) % 2;
            times[which].push(peers[which].round_trip_us(line));
        }
        // the bench measures the rate of the readings
        thread::sleep((PERIOD * index as u32).saturating_sub(began.elapsed()));
    }
    let [ours, echos] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        [0.5, 0.99, 1.0].map(|share| percentile(&times, share))
    });
    let row = ours.iter().zip(echos).map(|(ours, echo)| format!("{ours:>8.0} ({echo:>5.0})"));
    println!("  {name:<46} {}", row.collect::<Vec<_>>().join(" "));
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

fn server(folder: &Path) -> Peer {
    let words = ["serve", "--model", "sensor.palpate", "--listen", "127.0.0.1:0", "--quiet", "--json"];
    let mut child = started(PALPATE, &words, folder);
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
    Peer::socket(line.trim().trim_start_matches("listening at "), Some(child))
}

fn started(program: &str, words: &[&str], folder: &Path) -> Child {
    let mut command = Command::new(program);
    let command = command.args(words).current_dir(folder).stdin(Stdio::piped()).stdout(Stdio::piped());
    command.stderr(Stdio::null()).spawn().expect("the program starts")
}

fn run(folder: &Path, words: &[&str]) {
    let mut command = Command::new(PALPATE);
    let status = command.args(words).current_dir(folder).stderr(Stdio::null()).stdout(Stdio::null()).status();
    assert!(status.expect("the program starts").success(), "{words:?}");
}

fn write_table(folder: &Path, presses: &[palpate_testing::skins::Pressed]) {
    let outputs: Vec<String> = (1..=presses[0].2.len()).map(|output| format!("out_{output}")).collect();
    let mut table = format!("x_mm,y_mm,force_n,{}\n", outputs.join(","));
    for (place, force_n, outputs) in presses {
        write!(table, "{},{},{force_n}", place.x_mm, place.y_mm).expect("a string takes all");
        outputs.iter().for_each(|output| write!(table, ",{output}").expect("a string takes all"));
        table.push('\n');
    }
    std::fs::write(folder.join("table.csv"), table).expect("a folder of its own");
}
