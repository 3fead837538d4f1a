//! A real link and a run's folder have one owner as long as it lives; simulated rigs run at the same time.
#![cfg(unix)]

use palpate_testing::served::ServedProgram;
use palpate_testing::{CommandOutput, Live, SMALL, SMALL_PRESSES, TestFolder, exchanged, shipped_text};
use std::fs;
use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::process::Command;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

/// A press that is held longer than the test takes.
const HELD: &str =
    "name = \"held\"\nrig = \"sim\"\n[press]\nhold_s = 600\n[[step]]\nphase = \"test\"\nforce_n = 1.0\nunits = [5]\n";

/// Longest wait until our own connection is accepted.
const PATIENCE: Duration = Duration::from_secs(20);

/// Runs at the same time, and their pace: slow enough that each begins before any has ended.
const SIDE_BY_SIDE: usize = 4;
const PACE: &str = "--pace 10";

#[test]
fn real_link_has_one_owner_and_is_free_after_its_kill() {
    // all of it TCP: the stage and the load cell are sockets of one controller
    let served = ServedProgram::new(&shipped_text("rigs/xps.toml"), "");
    let (stage, array) = (Gate::to(served.address("stage")), Gate::to(served.address("array")));
    let rig = |stage: &str, array: &str| {
        let rig = shipped_text("rigs/xps.toml").replace("192.168.0.254:5001", stage);
        exchanged(&rig, "192.168.1.10:502", array)
    };
    let elsewhere = "127.0.0.1:9"; // no program gets far enough to notice the missing device
    let bench = TestFolder::with([
        ("held.toml", HELD),
        ("rig.toml", &rig(&stage.address(), &array.address())),
        ("other.toml", &rig(elsewhere, &array.address())),
    ]);
    fs::create_dir(bench.path("tmp")).expect("a folder");

    let owner = Live::start(in_own_folder(&bench, "run held.toml --rig rig.toml --out held --confirmed down"));
    owner.until_printed(": from press 1");
    let used = [stage.connections(), array.connections()];
    for words in ["run held.toml --rig rig.toml --out second", "doctor rig.toml --json", "align rig.toml"] {
        let printed = refused(&bench, words);
        let expected = format!("stage: while opening its link: tcp://{} is in use by another palpate", stage.address());
        assert!(printed.running().contains(&expected), "{words}: {}", printed.err);
        assert!(
            printed.running().contains(&format!("(process {}): end it, or wait for it", owner.id())),
            "{}",
            printed.err
        );
    }
    let printed = refused(&bench, "doctor other.toml");
    let expected = format!("array: while opening its link: tcp://{} is in use by", array.address());
    assert!(printed.running().contains(&expected), "one link of three is enough: {}", printed.err);
    assert_eq!([stage.connections(), array.connections()], used, "nothing reaches the devices");
    assert_eq!(bench.manifest("second")["status"], "failed");

    owner.signal("KILL");
    assert_eq!(owner.end().code, None);
    let printed: CommandOutput =
        in_own_folder(&bench, "doctor rig.toml --confirmed down").output().expect("the program starts").into();
    // the devices are free; nothing has shown that the load cell measures force
    assert_eq!(printed.code, Some(1), "{}\n{}", printed.out, printed.err);
    let left = fs::read_dir(bench.path("tmp")).expect("a folder").count();
    assert_eq!(left, 0, "no lock file outlives its program: the last owner removed those of the killed one");
}

#[test]
fn without_a_temporary_folder_a_real_rig_is_refused_and_a_simulated_one_runs() {
    let bench = TestFolder::with([("r.toml", SMALL), ("rig.toml", shipped_text("rigs/xps.toml").as_str())]);
    // there is no folder tmp
    let printed = refused(&bench, "run r.toml --rig rig.toml --out real");
    let running = printed.running();
    assert!(running.contains("set TMPDIR to use another folder"), "{}", printed.err);
    let printed: CommandOutput =
        in_own_folder(&bench, "run r.toml --out run").output().expect("the program starts").into();
    assert_eq!(printed.code, Some(0), "{}", printed.err);
}

#[test]
fn run_folder_has_one_writer_and_is_free_after_its_kill() {
    let bench = TestFolder::with([("held.toml", HELD)]);
    let begun = Live::start(bench.command(&format!("run held.toml --out run {PACE}")));
    begun.until_printed(": from press 1");
    begun.signal("TERM");
    assert_eq!(begun.end().code, Some(130));
    let writer = Live::start(bench.command(&format!("resume run {PACE}")));
    writer.until_printed(": from press 1");
    let before = bench.read("run/journal.log");
    let output = bench.palpate_ends(2, "resume run");
    assert!(output.running().contains("is being written by another program"), "{}", output.err);
    // the writer holds its press, and records nothing meanwhile
    assert_eq!(bench.read("run/journal.log"), before, "the other one writes nothing");
    writer.signal("KILL");
    assert_eq!(writer.end().code, None);
    bench.palpate_ends(0, "resume run");
    assert_eq!(bench.manifest("run")["presses_done"], 1);
}

#[test]
fn simulated_rigs_run_at_the_same_time() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    fs::create_dir(bench.path("tmp")).expect("a folder");
    let words = |n: usize| format!("run r.toml --out run-{n} {PACE}");
    let runs: Vec<Live> = (0..SIDE_BY_SIDE).map(|n| Live::start(in_own_folder(&bench, &words(n)))).collect();
    runs.iter().for_each(|run| run.until_printed(": from press 1"));
    for (n, run) in runs.into_iter().enumerate() {
        let output = run.end();
        assert_eq!(output.code, Some(0), "{}", output.err);
        assert_eq!(bench.manifest(&format!("run-{n}"))["presses_done"], SMALL_PRESSES);
    }
    assert_eq!(fs::read_dir(bench.path("tmp")).expect("a folder").count(), 0, "what is simulated isn't locked");
}

/// The program with its own folder of locks.
fn in_own_folder(bench: &TestFolder, words: &str) -> Command {
    let mut command = bench.command(words);
    command.env("TMPDIR", bench.path("tmp"));
    command
}

/// It ends like a program whose device isn't available.
fn refused(bench: &TestFolder, words: &str) -> CommandOutput {
    let printed: CommandOutput = in_own_folder(bench, words).output().expect("the program starts").into();
    assert_eq!(printed.code, Some(3), "{words}\n{}\n{}", printed.out, printed.err);
    printed
}

/// A proxy to a server that counts connections.
struct Gate {
    address: SocketAddr,
    came: Receiver<SocketAddr>,
    count: std::cell::Cell<usize>,
}

impl Gate {
    fn to(server: &str) -> Gate {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let (sender, came) = channel();
        let server = server.to_owned();
        // ends with the test's process
        thread::spawn(move || {
            for stream in listener.incoming() {
                let stream = stream.expect("a connection");
                if sender.send(stream.peer_addr().expect("an address")).is_ok() {
                    pass_on(stream, &server);
                }
            }
        });
        Gate { address, came, count: 0.into() }
    }

    fn address(&self) -> String {
        self.address.to_string()
    }

    /// Number of connections until now, without this one.
    fn connections(&self) -> usize {
        // connections are accepted in order, so all earlier ones have been counted
        let own = TcpStream::connect(self.address).and_then(|stream| stream.local_addr()).expect("connects");
        while self.came.recv_timeout(PATIENCE).expect("our own connection") != own {
            self.count.set(self.count.get() + 1);
        }
        self.count.get()
    }
}

/// Carries bytes both ways, until either end closes.
fn pass_on(near: TcpStream, server: &str) {
    let far = TcpStream::connect(server).expect("the server listens");
    for (from, to) in [(&near, &far), (&far, &near)] {
        let (mut from, mut to) = (from.try_clone().expect("a handle"), to.try_clone().expect("a handle"));
        to.set_nodelay(true).expect("takes it");
        thread::spawn(move || {
            // an error means that the end has gone
            let _ = io::copy(&mut from, &mut to);
            let _ = to.shutdown(Shutdown::Both);
        });
    }
}
