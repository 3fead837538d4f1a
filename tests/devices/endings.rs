//! Device programs end with palpate in any case: first the end of their input, then a deadline, then signals to their group, as in
//! `docs/reference/process.md`.
//!
//! They are shell scripts. Each event of a script is a file of that name, whose time is that of the event.

use palpate_testing::{CommandOutput, Live, SMALL, TestFolder, exchanged, shipped_text};
use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

/// Plays a role (the first word) with some behaviour (the second one).
const DEVICE: &str = r#"
role=$1 manner=$2 x=0.0 y=0.0 z=0.0 moving=false noise=1
note() { : > "$role.$1"; }
tell() { printf '{"id": %s%s}\n' "$id" "$1"; }
sleep_on() { note hung; sleep 60 & wait; }
misbehave() {
    case $manner in
        mute) note hung ;;
        hung | stubborn) sleep_on ;;
        dead) sleep 60 >&2 & note hung; exit 1 ;;
        flooding) note hung; while :; do echo '{"id": null}'; done ;;
        *) return 1 ;;
    esac
}
echo $$ > "$role.pid"
case $manner in
    stubborn) trap '' TERM ;;
    hung | deaf) trap 'note term; exit 0' TERM ;;
esac
while read -r line; do
    id=${line##*'"id":'}
    id=${id%%[,\}]*}
    case $line in
        *'"identify"'*)
            [ "$role" != stage ] && misbehave && continue
            version=1; [ "$role" = stage ] && version=2
            tell ", \"role\": \"$role\", \"protocol\": $version, \"units\": 9, \"identity\": \"a script\"" ;;
        *'"prepare"'*)
            note prepared
            case $line in *'"home_side":"toward"'*) note toward ;; esac
            misbehave && continue
            z=12.5
            tell ;;
        *'"stop"'*)
            note stop
            [ $moving = true ] && note stopped
            moving=false ;;
        *'"move"'*)
            ways=${line##*'"by_mm":{'}
            ways=${ways%%\}*}
            for axis in x y z; do
                case $ways in *"\"$axis\":"*)
                    by=${ways##*"\"$axis\":"}
                    eval "$axis=\$(awk \"BEGIN { print \$$axis + ${by%%,*} }\")" ;;
                esac
            done
            # the first motion goes on until it is stopped
            [ "$manner" = slow ] && ! [ -e stage.moving ] && moving=true && note moving
            tell ;;
        *'"status"'*)
            tell ", \"moving\": $moving, \"position_mm\": {\"x\": $x, \"y\": $y, \"z\": $z}" ;;
        *'"read"'*)
            if [ "$role" = array ]; then
                tell ', "outputs": [0, 0, 0, 0, 0, 0, 0, 0, 0]'
            elif [ "$manner" = watching ] && [ -e stage.moving ]; then
                [ -e "$role.hung" ] || note hung
            else
                noise=$(((noise * 1103515245 + 12345) % 2147483648))
                tell ", \"force_n\": 0.000$((noise / 65536 % 90 + 10))"
            fi ;;
    esac
done
note eof
case $manner in
    deaf) sleep_on ;;
    late) sleep 0.7; echo 'a last word'; note rest ;;
esac
"#;

/// The documented deadlines: from the end of the input to SIGTERM, and then to SIGKILL, s.
const TERM_S: f64 = 2.0;
const KILL_S: f64 = 1.0;

/// Wait for a stage that was stopped while it is prepared, s.
const STOPPED_S: f64 = 2.0;

/// Extra time on a busy machine, s: much less than the deadline of 120 s for the missing answers.
const BUSY_S: f64 = 8.0;

/// Largest delay of the clock of files, s.
const CLOCK_S: f64 = 0.05;

/// Longest wait for the next event of a program.
const PATIENCE: Duration = Duration::from_secs(20);

/// A rig of three scripts with different behaviours.
struct Scripts {
    bench: TestFolder,
}

impl Scripts {
    fn new(stage: &str, load_cell: &str, array: &str) -> Scripts {
        let program = |role: &str, manner: &str| format!("[\"sh\", \"device.sh\", \"{role}\", \"{manner}\"]");
        let rig = shipped_text("rigs/process.toml");
        let rig = exchanged(&rig, r#"["python3", "examples/stage.py"]"#, &program("stage", stage));
        let rig = exchanged(&rig, r#"["python3", "examples/load_cell.py"]"#, &program("load_cell", load_cell));
        let rig = exchanged(&rig, r#"["python3", "examples/array.py", "9"]"#, &program("array", array));
        Scripts { bench: TestFolder::with([("rig.toml", rig.as_str()), ("device.sh", DEVICE), ("r.toml", SMALL)]) }
    }

    /// The same, whose stage homes toward the specimen.
    fn that_homes_toward() -> Scripts {
        let scripts = Scripts::new("sound", "sound", "sound");
        let rig = exchanged(&scripts.bench.read("rig.toml"), "settle_ms = 10.0", "home_side = \"toward\"");
        scripts.bench.write("rig.toml", &rig);
        scripts
    }

    fn run(&self) -> Live {
        Live::start(self.bench.command("run r.toml --rig rig.toml --out run --confirmed down"))
    }

    fn doctor(&self) -> Live {
        Live::start(self.bench.command("doctor rig.toml --confirmed down"))
    }

    /// Time of an event.
    fn at(&self, event: &str) -> SystemTime {
        let noted = fs::metadata(self.bench.path(event)).and_then(|file| file.modified());
        noted.unwrap_or_else(|error| panic!("{event}: {error}"))
    }

    fn until(&self, event: &str) {
        let began = Instant::now();
        while !self.bench.has(event) {
            assert!(began.elapsed() < PATIENCE, "no {event}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Time from the first event to the second one, s.
    fn between_s(&self, first: &str, second: &str) -> f64 {
        since_s(self.at(first), self.at(second))
    }

    /// Checks that no process of the groups is left.
    fn assert_all_ended(&self) {
        for role in ["stage", "load_cell", "array"].iter().filter(|role| self.bench.has(&format!("{role}.pid"))) {
            let group = self.bench.read(&format!("{role}.pid")).trim().to_owned();
            assert_eq!(members(&group), "", "left of the {role}");
        }
    }
}

/// The processes of a group, except for ended ones whose parent hasn't asked about them.
fn members(group: &str) -> String {
    match Command::new("ps").args(["-A", "-o", "pgid=", "-o", "stat=", "-o", "args="]).output() {
        Ok(listed) => {
            let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
            let is_member = |line: &&str| {
                let mut words = line.split_whitespace();
                words.next() == Some(group) && words.next().is_some_and(|state| !state.starts_with('Z'))
            };
            listed.lines().filter(is_member).collect::<Vec<_>>().join("; ")
        }
        Err(_) => {
            let group = format!("-{group}");
            let asked = Command::new("kill").args(["-0", "--", &group]).stderr(Stdio::null()).status();
            if asked.is_ok_and(|status| status.success()) { group } else { String::new() }
        }
    }
}

/// Resolution of a file's clock, within which the order of events isn't known.
fn since_s(first: SystemTime, second: SystemTime) -> f64 {
    second.duration_since(first).map_or_else(|error| -error.duration().as_secs_f64(), |since| since.as_secs_f64())
}

/// Ends a program; returns the time since a moment.
fn ended(live: Live, from: SystemTime) -> (CommandOutput, f64) {
    let output = live.end();
    (output, since_s(from, SystemTime::now()))
}

fn assert_within(what: &str, s: f64, least_s: f64, most_s: f64) {
    eprintln!("{what}: {s:.3} s");
    assert!((least_s - CLOCK_S..most_s).contains(&s), "{what}: {s:.3} s isn't within {least_s} to {most_s} s");
}

#[test]
fn a_search_for_home_toward_the_specimen_waits_for_a_person_who_confirms_it() {
    let scripts = Scripts::that_homes_toward();
    let output = Live::start(scripts.bench.command("doctor rig.toml --confirmed down")).end();
    let said = output.running();
    let expected = "homes z toward the specimen, it isn't confirmed that nothing is in the way, and there is no terminal to ask \
                    at: nothing was moved. Take the indenter off or the specimen away, then add --confirmed clear";
    assert!(said.contains(expected), "{said}");
    assert!(!scripts.bench.has("stage.prepared"), "it was prepared");
    let output = Live::start(scripts.bench.command("retract rig.toml --confirmed down")).end();
    let expected = "this stage doesn't know its position, and homes z toward the specimen (`home_side`): nothing was moved. Bring z \
                    away from the specimen by hand";
    assert!(output.running().contains(expected), "{}", output.err);
    assert!(!scripts.bench.has("stage.prepared"), "it was prepared");
    Live::start(scripts.bench.command("doctor rig.toml --confirmed down --confirmed clear")).end();
    assert!(scripts.bench.has("stage.toward"), "it was not sent home");
}

#[test]
fn program_that_ends_with_its_input_gets_no_signal() {
    let scripts = Scripts::new("late", "well", "well");
    let (output, _) = ended(scripts.doctor(), SystemTime::now());
    // equal outputs aren't an error for the doctor; nothing shows that the load cell measures force
    assert_eq!(output.code, Some(1), "{}{}", output.out, output.err);
    assert!(scripts.bench.has("stage.rest"), "it was ended before its device was at rest, or by its last word");
    assert_within("at rest after the end of its input", scripts.between_s("stage.eof", "stage.rest"), 0.7, TERM_S);
    assert_within("the others' ends", scripts.between_s("stage.eof", "array.eof").abs(), 0.0, TERM_S);
    scripts.assert_all_ended();
}

#[test]
fn program_that_ignores_the_end_of_its_input_gets_sigterm_then_sigkill() {
    let scripts = Scripts::new("well", "deaf", "well");
    let (output, end_s) = {
        let live = scripts.doctor();
        scripts.until("load_cell.eof");
        ended(live, scripts.at("load_cell.eof"))
    };
    assert_eq!(output.code, Some(1), "{}{}", output.out, output.err);
    assert_within("SIGTERM", scripts.between_s("load_cell.eof", "load_cell.term"), TERM_S, TERM_S + BUSY_S);
    assert_within("the end", end_s, TERM_S, TERM_S + BUSY_S);
    scripts.assert_all_ended();

    let scripts = Scripts::new("stubborn", "well", "well");
    let live = scripts.run();
    scripts.until("stage.hung");
    let asked = SystemTime::now();
    live.signal("TERM");
    let (output, end_s) = ended(live, asked);
    assert_eq!(output.code, Some(130), "{}", output.err);
    let whole_s = STOPPED_S + TERM_S + KILL_S;
    assert_within("the end of who ignores SIGTERM too", end_s, whole_s, whole_s + BUSY_S);
    scripts.assert_all_ended();
}

#[test]
fn stage_that_hangs_in_prepare_ends_at_ctrl_c() {
    for (manner, signal) in [("mute", "INT"), ("mute", "TERM"), ("hung", "INT"), ("hung", "TERM")] {
        let scripts = Scripts::new(manner, "well", "well");
        let live = scripts.run();
        scripts.until("stage.hung");
        let asked = SystemTime::now();
        live.signal(signal);
        let (output, end_s) = ended(live, asked);
        assert_eq!(output.code, Some(130), "{manner}, {signal}: {}", output.err);
        assert!(output.err.contains("stopping") && !output.err.contains("finished first"), "{}", output.err);
        let least_s = if manner == "hung" { STOPPED_S + TERM_S } else { STOPPED_S };
        assert_within(&format!("{manner}, {signal}"), end_s, least_s, least_s + BUSY_S);
        if manner == "mute" {
            assert!(scripts.between_s("stage.stop", "stage.eof") > -CLOCK_S, "the stop comes first");
            assert!(!scripts.bench.has("stage.term"));
        } else {
            assert!(scripts.bench.has("stage.term"));
        }
        assert!(scripts.bench.has("array.pid"), "the array is watched while the stage homes");
        scripts.assert_all_ended();
    }
}

#[test]
fn reader_that_hangs_in_prepare_ends_at_ctrl_c() {
    for (load_cell, array) in [("mute", "well"), ("well", "mute")] {
        let scripts = Scripts::new("well", load_cell, array);
        let role = if load_cell == "mute" { "load_cell" } else { "array" };
        let live = if role == "array" { scripts.run() } else { scripts.doctor() };
        scripts.until(&format!("{role}.hung"));
        let asked = SystemTime::now();
        live.signal("INT");
        let (output, end_s) = ended(live, asked);
        assert_eq!(output.code, Some(130), "{role}: {}", output.err);
        assert_within(&format!("the end, {role}"), end_s, 0.0, BUSY_S);
        scripts.assert_all_ended();
    }
}

#[test]
fn children_of_a_dead_program_end_too() {
    let scripts = Scripts::new("dead", "well", "well");
    let live = scripts.run();
    scripts.until("stage.hung");
    let (output, end_s) = ended(live, scripts.at("stage.hung"));
    assert_eq!(output.code, Some(3), "{}", output.err);
    assert_within("the end after the program's", end_s, TERM_S, TERM_S + BUSY_S);
    scripts.assert_all_ended();
}

#[test]
fn a_program_that_floods_is_reported_and_ended() {
    let scripts = Scripts::new("flooding", "well", "well");
    let live = scripts.run();
    scripts.until("stage.hung");
    let (output, end_s) = ended(live, scripts.at("stage.hung"));
    assert_eq!(output.code, Some(3), "{}", output.err);
    assert!(output.running().contains("it answered \"64 lines\", expected one JSON object"), "{}", output.err);
    assert_within("the end after the flood began", end_s, TERM_S, TERM_S + BUSY_S);
    scripts.assert_all_ended();
}

#[test]
fn load_cell_that_hangs_in_a_motion_stops_it_and_ends_the_run_soon() {
    let scripts = Scripts::new("slow", "watching", "well");
    let live = scripts.run();
    scripts.until("load_cell.hung");
    let (output, end_s) = ended(live, scripts.at("load_cell.hung"));
    assert_eq!(output.code, Some(3), "{}", output.err);
    assert!(output.running().contains("while reading the force: no answer to \"read\""), "{}", output.err);
    assert_within("the stop after the last reading", scripts.between_s("load_cell.hung", "stage.stopped"), 0.25, 1.5);
    assert_within("the end after the last reading", end_s, 0.5, 1.9);
    scripts.assert_all_ended();
}
