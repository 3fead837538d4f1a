//! `[notify]`: the lines for a receiver; a dead, slow or missing one doesn't change a batch.

use super::{bench, events, piped};
use palpate_data::dataset::Status;
use palpate_run::batch::BatchEvent;
use palpate_testing::TestFolder;
use palpate_testing::terminal::{TestTerminal, signal, spawned, wait};

const RUN: &str = "batch run b.toml --out day";

fn receiver(script: &str) -> String {
    format!("[notify]\ncommand = [\"sh\", \"-c\", \"{script}\"]\n")
}

fn got(bench: &TestFolder) -> Vec<BatchEvent> {
    bench.read("got").lines().map(|line| serde_json::from_str(line).expect(line)).collect()
}

#[test]
fn receiver_gets_each_verdict_and_the_end_as_in_the_journal() {
    let bench = bench(&receiver("cat > got"));
    let output = piped(&bench, RUN, &["B-1", "A-01", ".note clean", "A-02"]);
    assert_eq!((output.code, output.err.contains("notify")), (Some(0), false), "{}", output.err);
    let is_passed = |event: &BatchEvent| matches!(event, BatchEvent::Ended(_) | BatchEvent::Closed { .. });
    let expected: Vec<BatchEvent> = events(&bench, "day").into_iter().filter(is_passed).collect();
    assert_eq!(expected.len(), 3);
    assert_eq!(got(&bench), expected);
}

#[test]
fn a_receiver_that_fails_changes_no_result() {
    for (script, said) in [
        ("exit 3", "notify: sh didn't get "),
        ("read line; exit 0", "notify: sh didn't get "),
        ("cat > /dev/null; exit 4", "notify: sh didn't get 0 of 3 events; it ended with exit status: 4"),
    ] {
        let bench = bench(&receiver(script));
        let output = piped(&bench, RUN, &["A-01", "A-02"]);
        assert_eq!(output.code, Some(0), "{}", output.err);
        // a receiver that dies may die after its last line was written
        assert!(output.err.contains(said) || script.starts_with("read"), "{script}: {}", output.err);
        assert!(output.err.matches("notify:").count() <= 1, "{}", output.err);
        let complete =
            |event: &BatchEvent| matches!(event, BatchEvent::Ended(ended) if ended.status == Status::Complete);
        assert_eq!(events(&bench, "day").iter().filter(|event| complete(event)).count(), 2);
    }
}

#[test]
fn a_missing_program_is_reported_once_and_the_batch_continues() {
    let bench = bench("[notify]\ncommand = [\"no-such-program-anywhere\"]\n");
    let output = piped(&bench, RUN, &["A-01"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    assert_eq!(output.err.matches("notify:").count(), 1, "{}", output.err);
    let words = "no-such-program-anywhere can't be started";
    assert!(output.running().contains(words), "{}", output.err);
    assert!(matches!(events(&bench, "day").last(), Some(BatchEvent::Closed { .. })));
}

#[test]
fn a_pause_is_passed_on_but_not_recorded() {
    let bench = bench(&receiver("cat > got"));
    let mut terminal = TestTerminal::open();
    let mut command = bench.command(&format!("{RUN} --pace 20"));
    command.stdin(terminal.far()).stdout(terminal.far()).stderr(terminal.far());
    let child = spawned(&mut command);
    drop(command); // it is at the terminal too
    terminal.until(") > ");
    terminal.line("A-01");
    terminal.until("calibration");
    signal(&child, "INT");
    terminal.until("paused after ");
    terminal.until("Enter continues");
    terminal.enter();
    terminal.until("A-02");
    terminal.line(".end");
    let said = terminal.until_end();
    assert_eq!(wait(child), Some(0), "{said}");
    let passed = got(&bench);
    assert!(matches!(&passed[0], BatchEvent::Paused { serial, .. } if serial == "A-01"), "{passed:?}");
    assert!(matches!(&passed[1..], [BatchEvent::Ended(_), BatchEvent::Closed { .. }]), "{passed:?}");
    assert!(!events(&bench, "day").iter().any(|event| matches!(event, BatchEvent::Paused { .. })));
}

#[test]
fn the_receiver_of_a_rig_gets_the_end_of_each_run_and_of_a_batch() {
    let receiver = receiver("cat >> got");
    let fault = "\n[[scene.fault]]\nkind = \"hard-contact\"\nfrom_s = 30.0\nvalue = 60.0\n";
    let bench = bench("");
    let rig = bench.read("rig.toml");
    bench.write("rig.toml", &format!("{rig}\n{receiver}"));
    let output = bench.palpate("run r.toml --rig rig.toml --sensor A-7 --out good");
    assert!(matches!(output.code, Some(0 | 1)), "{}", output.err);
    bench.write("hard.toml", &format!("{rig}\n{receiver}{fault}"));
    bench.palpate_ends(4, "run r.toml --rig hard.toml --out hard");
    let ended: Vec<BatchEvent> = got(&bench);
    let [BatchEvent::Ended(good), BatchEvent::Ended(hard)] = ended.as_slice() else { panic!("{ended:?}") };
    assert_eq!(
        (good.serial.as_str(), good.status, good.runs.as_slice()),
        ("A-7", Status::Complete, &["good".to_owned()][..])
    );
    assert!(good.verdict.is_some() && good.calibration_presses == 9, "{good:?}");
    assert_eq!((hard.status, hard.verdict), (Status::Tripped, None));
    assert!(hard.reasons[0].contains("contact") || hard.reasons[0].contains("force"), "{hard:?}");
    // another program may be notified after a pause
    bench.write("changed.toml", &rig);
    assert_ne!(bench.palpate("resume good --rig changed.toml").code, Some(3));
    let output = piped(&bench, RUN, &["A-01"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    assert!(
        got(&bench).iter().skip(2).any(|event| matches!(event, BatchEvent::Ended(ended) if ended.serial == "A-01"))
    );
}
