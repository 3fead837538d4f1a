//! A day: 30 sensors, typed by a person with a scanner. Two serial numbers are wrong, one is scanned twice, the program is killed in a
//! run, and the array is unplugged in another. Nothing is lost, and nothing is judged twice.

use super::{begun, bench, break_rig, complete, events, mend_rig, results};
use palpate_data::dataset::Status;
use palpate_run::batch::BatchEvent;
use palpate_testing::TestFolder;
use palpate_testing::terminal::{TestTerminal, signal, spawned, wait};
use std::collections::BTreeSet;
use std::process::Child;

/// Sensors, and those with an incident.
const SENSORS: usize = 30;
const KILLED: usize = 15;
const UNPLUGGED: usize = 20;

/// Time of unplugging the array, s: after the quick check, within the run.
const UNPLUGGED_S: f64 = 50.0;

/// End of every question.
const QUESTION: &str = ") > ";

/// Pace of the run that is killed: it takes some seconds.
const SLOW: &str = "--pace 5";

/// A person at the terminal of a batch.
struct DayPerson {
    terminal: TestTerminal,
    child: Child,
}

impl DayPerson {
    fn begins(bench: &TestFolder, more: &str) -> DayPerson {
        let terminal = TestTerminal::open();
        let mut command = bench.command(&format!("batch run b.toml --out day {more}"));
        command.stdin(terminal.far()).stdout(terminal.far()).stderr(terminal.far());
        let child = spawned(&mut command);
        DayPerson { terminal, child }
    }

    /// Waits for the next question, types a line, and returns the output before the question.
    fn types(&mut self, line: &str) -> String {
        let said = self.terminal.until(QUESTION);
        self.terminal.line(line);
        said
    }

    fn until(&mut self, words: &str) {
        self.terminal.until(words);
    }

    fn ends(mut self) -> String {
        let said = self.types(".end");
        let seen = self.terminal.until_end();
        assert_eq!(wait(self.child), Some(0), "{seen}");
        said
    }
}

fn serial(number: usize) -> String {
    format!("A-{number:02}")
}

#[test]
fn day_with_30_sensors_loses_nothing_and_judges_nothing_twice() {
    let bench = bench("");
    let mut person = DayPerson::begins(&bench, "");
    for number in 1..KILLED {
        person.types(&serial(number));
        match number {
            5 => {
                person.types("B-77");
                person.until("refused: B-77");
            }
            9 => {
                person.types("A 10");
                person.until("refused: A 10");
            }
            12 => {
                person.types("A-03");
                person.until("A-03 was calibrated already");
            }
            _ => {}
        }
    }
    let said = person.ends();
    assert!(said.contains("####") && said.contains("A-14"), "the result is large: {said}");

    // killed in the middle of a run
    let mut person = DayPerson::begins(&bench, SLOW);
    person.types(&serial(KILLED));
    person.until("calibration");
    person.child.kill().expect("it runs");
    person.child.wait().expect("it ends");
    drop(person);

    let mut person = DayPerson::begins(&bench, "");
    person.until("A-15 was interrupted; its presses are in runs/A-15.");
    person.types(&serial(KILLED));
    person.until("A-15 is interrupted: type `.repeat A-15` to allow it again");
    person.types(".repeat A-15");
    for number in KILLED..UNPLUGGED {
        person.types(&serial(number));
    }
    person.ends();

    break_rig(&bench, "array-lost", UNPLUGGED_S);
    let mut person = DayPerson::begins(&bench, "");
    person.until("the rig has changed");
    person.types(&serial(UNPLUGGED));
    let said = person.ends();
    assert!(said.contains("A-20") && said.contains("to calibrate it again: .repeat A-20"), "{said}");

    mend_rig(&bench);
    let mut person = DayPerson::begins(&bench, "");
    person.types(".repeat A-20");
    for number in UNPLUGGED..=SENSORS {
        person.types(&serial(number));
    }
    person.until("no sensor is waiting");
    person.ends();
    assert_day(&bench);
}

fn assert_day(bench: &TestFolder) {
    let events = events(bench, "day");
    let mut mountings = BTreeSet::new();
    for number in 1..=SENSORS {
        let serial = serial(number);
        assert_eq!(complete(&events, &serial), 1, "{serial} has one result");
        let last = results(&events, &serial).last().copied().expect("a result");
        assert!(last.verdict.is_some() && last.found.len() == 1 && last.calibration_presses == 9, "{last:?}");
        let again = number == KILLED || number == UNPLUGGED;
        assert_eq!(last.runs, [if again { format!("runs/{serial}-2") } else { format!("runs/{serial}") }]);
        assert_eq!(begun(&events, &serial), if again { 2 } else { 1 }, "{serial}");
        let manifest = bench.manifest(&format!("day/{}", last.runs[0]));
        assert_eq!((&manifest["status"], &manifest["sensor"]), (&"complete".into(), &serial.as_str().into()));
        for (label, expected) in [("design", "skin"), ("batch", "day"), ("operator", "Ada")] {
            assert_eq!(manifest[label], expected, "{serial}");
        }
        assert!(mountings.insert(manifest["mounting"].to_string()), "each mounting is a new one");
    }
    assert_eq!(results(&events, "A-15").len(), 1, "what was killed has no result");
    let unplugged = results(&events, "A-20")[0];
    assert_eq!((unplugged.status, unplugged.runs.len(), unplugged.verdict), (Status::Failed, 1, None), "{unplugged:?}");
    assert!(
        bench.manifest("day/runs/A-20")["presses_done"].as_u64().expect("a number") > 0,
        "in the middle of its run"
    );
    let refused: Vec<&str> = events
        .iter()
        .filter_map(|event| if let BatchEvent::Refused { typed, .. } = event { Some(typed.as_str()) } else { None })
        .collect();
    assert_eq!(refused, ["B-77", "A 10", "A-03", "A-15"]);
    let status = bench.palpate_ends(0, "batch status day --json").json_lines();
    let judged = |name: &str| status[0]["counts"][name].as_u64().expect("a number");
    assert_eq!(judged("accepted") + judged("not-accepted"), SENSORS as u64, "{}", status[0]["counts"]);
    // the run that was killed is an ordinary run
    bench.palpate("resume day/runs/A-15"); // its exit code is that of the verdict
    assert_eq!(bench.manifest("day/runs/A-15")["status"], "complete");
}

#[test]
fn interrupt_at_a_question_ends_the_batch_and_in_a_run_the_sensor() {
    let bench = bench("");
    let mut person = DayPerson::begins(&bench, SLOW);
    person.until(QUESTION);
    signal(&person.child, "INT");
    person.terminal.until_end();
    assert_eq!(wait(person.child), Some(130));
    assert_eq!(begun(&events(&bench, "day"), "A-01"), 0);

    let mut person = DayPerson::begins(&bench, SLOW);
    person.types("A-01");
    person.until("calibration");
    signal(&person.child, "TERM");
    person.until("to calibrate it again: .repeat A-01");
    person.terminal.until_end();
    assert_eq!(wait(person.child), Some(130));
    let events = events(&bench, "day");
    assert_eq!(results(&events, "A-01")[0].status, Status::Stopped);
    let output = bench.palpate_ends(0, "batch status day");
    assert!(output.out.contains("interrupted"), "{}", output.out);
}

#[cfg(target_os = "linux")]
#[test]
fn text_typed_during_a_run_is_discarded() {
    let bench = bench("");
    let mut person = DayPerson::begins(&bench, "--pace 10");
    person.types("A-01");
    person.until("calibration");
    person.terminal.line("A-02");
    person.types(".end");
    person.terminal.until_end();
    assert_eq!(wait(person.child), Some(0));
    let events = events(&bench, "day");
    assert_eq!((begun(&events, "A-01"), begun(&events, "A-02")), (1, 0));
}
