//! `palpate serve`: many connections, each a session of its own.

use palpate_testing::TestFolder;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::process::{Child, Stdio};
use std::thread;
use std::time::Duration;

/// Longest time that a test waits for bytes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A calibration of 49 presses on four units.
const CALIBRATION: &str = include_str!("sensor_files/calibration.csv");

fn fitted_file() -> TestFolder {
    let bench = TestFolder::with([("a.csv", CALIBRATION)]);
    bench.palpate_ends(0, "fit a.csv --solver surrogate --out s.palpate");
    bench
}

/// A server that ends with the test.
pub(crate) struct Server {
    child: Child,
    address: String,
}

impl Server {
    pub(crate) fn start(bench: &TestFolder, words: &str) -> Server {
        let mut command = bench.command(&format!("serve --listen 127.0.0.1:0 --quiet {words}"));
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the program starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
        let address = line.trim().strip_prefix("listening at ").expect("an address").to_owned();
        Server { child, address }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).expect("the server listens");
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_write_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends lines, closes that direction, and returns all answers.
    pub(crate) fn answers(&self, lines: &[u8]) -> String {
        let mut stream = self.connect();
        // a server that closes early reads no further
        _ = stream.write_all(lines);
        _ = stream.shutdown(Shutdown::Write);
        let mut text = String::new();
        _ = stream.read_to_string(&mut text);
        text
    }

    /// Largest memory that the server has used, kB; `None` where the system doesn't state it.
    fn peak_kb(&self) -> Option<u64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
        line.split_whitespace().nth(1)?.parse().ok()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        _ = self.child.kill();
        _ = self.child.wait();
    }
}

/// Readings as lines of JSON; two of seven lines aren't readings.
fn readings(count: usize, seed: usize) -> String {
    let line = |number: usize| match (number + seed) % 7 {
        3 => format!("{{\"outputs\": [{number}]}}\n"),
        5 => "null and void\n".to_owned(),
        _ => {
            let output = |unit: usize| 0.1 + ((number * 31 + unit * 17 + seed * 7) % 97) as f64 / 100.0;
            let outputs: Vec<String> = (0..4).map(|unit| output(unit).to_string()).collect();
            format!("{{\"id\": {number}, \"outputs\": [{}]}}\n", outputs.join(", "))
        }
    };
    "{\"outputs\": [1, 1, 1, 2]}\n".to_owned() + &(0..count).map(line).collect::<String>()
}

#[test]
fn a_connection_is_answered_as_standard_input_is() {
    let bench = fitted_file();
    let server = Server::start(&bench, "--model s.palpate --json");
    let text = readings(300, 0);
    bench.write("readings", &text);
    let input = std::fs::File::open(bench.path("readings")).unwrap();
    let mut command = bench.command("solve --model s.palpate --json --keep-going --quiet");
    let printed = command.stdin(input).output().expect("the program starts");
    let expected = String::from_utf8(printed.stdout).unwrap().replace("stdin", "PEER");
    let answers = server.answers(text.as_bytes());
    let peer = |line: &str| match line.find("127.0.0.1:") {
        Some(at) => {
            let end = line[at + 10..].find(|c: char| !c.is_ascii_digit()).map_or(line.len(), |end| at + 10 + end);
            format!("{}PEER{}", &line[..at], &line[end..])
        }
        None => line.to_owned(),
    };
    let answers: Vec<String> = answers.lines().map(peer).collect();
    assert_eq!(answers, expected.lines().collect::<Vec<&str>>());
    assert_eq!(answers.len(), 301);
    // CSV, the header by its names
    let server = Server::start(&bench, "--model s.palpate");
    let csv = "id,out_1,out_2,out_3,out_4\na,1,1,1,2\n";
    let answers = server.answers(csv.as_bytes());
    assert!(answers.starts_with("line,id,t_s,x_mm,") && answers.contains("\n2,a,,"), "{answers}");
    let answers = server.answers(b"out_1,out_3\n1,2\n");
    assert!(answers.starts_with("error: ") && answers.lines().count() == 1, "{answers}");
}

#[test]
fn a_browser_gets_no_answer() {
    let bench = fitted_file();
    let server = Server::start(&bench, "--model s.palpate --json");
    let form = "POST / HTTP/1.1\r\nHost: localhost\r\n\r\n[1,1,1,2]\n";
    assert_eq!(server.answers(form.as_bytes()), "");
    let later = format!("[1,1,1,2]\nGET / HTTP/1.1\r\n{}", "[1,1,1,2]\n".repeat(3));
    assert_eq!(server.answers(later.as_bytes()).lines().count(), 1);
}

/// A system queues only as many connections for a busy server as the server requested. It drops or resets further ones.
#[cfg(target_os = "linux")]
#[test]
fn connections_that_arrive_while_the_server_is_busy_are_answered() {
    use rustix::process::{Pid, Signal, kill_process};
    const CONNECTIONS: usize = 500;
    const CONNECTED_WITHIN: Duration = Duration::from_secs(5);
    let bench = fitted_file();
    let server = Server::start(&bench, "--model s.palpate --json");
    kill_process(Pid::from_child(&server.child), Signal::STOP).expect("the server stops");
    let address = server.address.parse().unwrap();
    let connect = |_| TcpStream::connect_timeout(&address, CONNECTED_WITHIN).expect("a connection");
    let streams: Vec<TcpStream> = (0..CONNECTIONS).map(connect).collect();
    kill_process(Pid::from_child(&server.child), Signal::CONT).expect("the server goes on");
    for mut stream in streams {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(b"[1,1,1,2]\n").unwrap();
        let mut line = String::new();
        BufReader::new(&stream).read_line(&mut line).unwrap();
        assert!(line.contains("\"verdict\""), "{line}");
    }
}

#[test]
fn five_hundred_connections_are_answered_in_bounded_memory() {
    const CONNECTIONS: usize = 500;
    let bench = fitted_file();
    let server = Server::start(&bench, "--model s.palpate --json");
    let before_kb = server.peak_kb();
    let alone: Vec<String> = (0..5).map(|seed| answered(&server.answers(readings(40, seed).as_bytes()))).collect();
    // clients that send half a line or nothing, and clients that never read
    let idle: Vec<TcpStream> = (0..CONNECTIONS / 5)
        .map(|number| {
            let mut stream = server.connect();
            if number % 2 == 0 {
                stream.write_all(b"{\"outputs\": [1, 1,").unwrap();
            }
            stream
        })
        .collect();
    let garbage: Vec<u8> = (0..200_000u32).map(|number| (number.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    thread::scope(|scope| {
        for client in 0..CONNECTIONS * 4 / 5 {
            let (server, alone, garbage) = (&server, &alone, &garbage);
            scope.spawn(move || match client % 8 {
                7 => _ = server.answers(&garbage[client..]),
                6 => _ = server.answers(&vec![b'7'; 3 << 20]),
                // one byte at a time
                5 => {
                    let text = readings(3, client % 5);
                    let mut stream = server.connect();
                    stream.set_nodelay(true).unwrap();
                    text.bytes().for_each(|byte| stream.write_all(&[byte]).unwrap());
                    stream.shutdown(Shutdown::Write).unwrap();
                    let mut got = String::new();
                    stream.read_to_string(&mut got).unwrap();
                    assert!(alone[client % 5].starts_with(&answered(&got)), "{got}");
                }
                _ => assert_eq!(answered(&server.answers(readings(40, client % 5).as_bytes())), alone[client % 5]),
            });
        }
    });
    // idle clients are answered
    for (number, mut stream) in idle.into_iter().enumerate() {
        let rest = if number % 2 == 0 { "1, 2]}\n" } else { "[1,1,1,2]\n" };
        stream.write_all(rest.as_bytes()).unwrap();
        let mut line = String::new();
        BufReader::new(&stream).read_line(&mut line).unwrap();
        assert!(line.contains("\"verdict\""), "{line}");
    }
    if let (Some(before_kb), Some(after_kb)) = (before_kb, server.peak_kb()) {
        println!("{CONNECTIONS} connections: {} kB more than none", after_kb - before_kb);
        assert!(after_kb - before_kb < 400 * 1024, "{before_kb} {after_kb}");
    }
}

/// Answers without the client's port.
fn answered(text: &str) -> String {
    let without = |line: &str| line.split(",\"error\"").next().unwrap_or_default().to_owned() + "\n";
    text.lines().map(without).collect()
}
