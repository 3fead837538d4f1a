//! The work of the commands without a command line.

use super::*;
use palpate_data::dataset::{RecordedContact, Status};
use palpate_run::run::{Cancel, Listener};
use std::cell::{Cell, RefCell};
use std::path::Path;

const EXAMPLE: &str = "data/example";

/// Makes the run of the example, and returns its options.
fn example(folder: &Path) -> RunOptions {
    let out = Some(folder.join("run"));
    RunOptions { recipe: Path::new(EXAMPLE).join("short.toml"), out, ..RunOptions::default() }
}

struct Counted<'a>(&'a Cell<usize>);

impl Listener for Counted<'_> {
    fn recorded(&mut self, _: &RecordedContact) {
        self.0.set(self.0.get() + 1);
    }
}

struct Deaf;

impl Listener for Deaf {}

#[test]
fn a_run_is_made_read_and_fitted() {
    let folder = tempfile::tempdir().unwrap();
    let mut begun = begin(&example(folder.path())).unwrap();
    let (presses, forces, planned) = (Cell::new(0), Cell::new(0_u64), begun.planned());
    let status = begun.execute(&Cancel::default(), &|_| forces.set(forces.get() + 1), &mut Counted(&presses)).unwrap();
    assert_eq!((status, presses.get()), (Status::Complete, planned));
    assert!(forces.get() > 1000);
    let notes = RefCell::new(Vec::new());
    let note = |line: &str| notes.borrow_mut().push(line.to_owned());
    let (recorded, _) = read_run(begun.path(), &note).unwrap();
    assert_eq!((recorded.contacts.len(), notes.borrow().len()), (planned, 0));
    let options = MethodOptions { solver: "pearson".to_owned(), ..MethodOptions::default() };
    let fitted = fit(begun.path(), &options, &note).unwrap();
    let file = folder.path().join("a.palpate");
    let bytes = fitted.model.to_bytes().unwrap();
    write_sensor(fitted.model, fitted.sensor, fitted.made_from, &file).unwrap();
    let read = read_sensor(&file, &note).unwrap();
    assert_eq!(read.model.to_bytes().unwrap(), bytes);
}

#[test]
fn a_stopped_run_resumes_and_a_complete_one_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let mut begun = begin(&example(folder.path())).unwrap();
    let (cancel, presses) = (Cancel::default(), Cell::new(0));
    cancel.ask();
    assert_eq!(begun.execute(&cancel, &|_| {}, &mut Counted(&presses)).unwrap(), Status::Stopped);
    assert_eq!(presses.get(), 0);
    drop(begun);
    let options = ResumeOptions { run: folder.path().join("run"), ..ResumeOptions::default() };
    let Resumed::Begun(mut begun) = resume(&options, &|_| {}).unwrap() else { panic!("it is complete") };
    assert_eq!(begun.execute(&Cancel::default(), &|_| {}, &mut Deaf).unwrap(), Status::Complete);
    let planned = begun.planned();
    drop(begun);
    assert!(matches!(
        resume(&options, &|_| {}).unwrap(),
        Resumed::Complete { planned: presses, is_rebuilt: false } if presses == planned
    ));
}

#[test]
fn a_run_is_evaluated_judged_reported_and_certified() {
    let folder = tempfile::tempdir().unwrap();
    let labels = LabelOptions { sensor: Some("A-017".to_owned()), ..LabelOptions::default() };
    let (path, results) = run(&RunOptions { labels, ..example(folder.path()) }, &mut Deaf).unwrap();
    let accept = AcceptOptions { accept: Some(Path::new(EXAMPLE).join("accept.toml")) };
    let options = EvaluateOptions { run: vec![path.clone()], accept: accept.clone(), ..EvaluateOptions::default() };
    let evaluated = evaluate(&options, &|_| {}).unwrap();
    assert!(evaluated.outcomes[0].1.is_ok() && results.judgement.is_none(), "the recipe has no rule");
    let verdict = evaluated.judgement.unwrap().verdict;
    let page = report(&ReportOptions { accept: accept.clone(), ..ReportOptions::of(vec![path.clone()]) }, &|_| {});
    let page = page.unwrap();
    assert!(!page.out.exists() && page.judgement.as_ref().is_some_and(|judgement| judgement.verdict == verdict));
    page.write().unwrap();
    assert_eq!(std::fs::read_to_string(path.join("report.html")).unwrap(), page.html);
    let with = Some(Path::new(EXAMPLE).join("certificate.toml"));
    let options = CertificateOptions { runs: vec![path], with, accept, ..CertificateOptions::default() };
    let certified = certificate(&options, &|_| {}).unwrap();
    assert!(certified.verdict == Some(verdict) && certified.html.exists() && certified.xml.exists());
    assert_eq!(
        certificate(&options, &|_| {}).err().map(|failure| failure.kind()),
        Some(FailureKind::Usage),
        "it exists"
    );
}

#[test]
fn readings_are_solved_line_by_line() {
    let options = SolveOptions {
        calibration: Some(Path::new(EXAMPLE).join("calibration.csv")),
        method: MethodOptions { solver: "pearson".to_owned(), ..MethodOptions::default() },
        ..SolveOptions::default()
    };
    let sensor = options.sensor(&|_| {}).unwrap();
    let (readings, mut contacts) = ("0.5,0.1,0.02,0.4,0.1,0.02,0.05,0.05,0.03\n1,2\n".as_bytes(), Vec::new());
    let failure = solve(sensor.model, &options, readings, &mut contacts, &|_| {}).unwrap_err();
    assert!(failure.kind() == FailureKind::Usage && failure.to_string().contains("line 2"), "{failure}");
    assert_eq!(String::from_utf8(contacts).unwrap().lines().count(), 2, "the header and the first contact");
}

#[test]
fn failure_has_the_message_and_code_of_the_command_line() {
    let failed = |failure: Option<Failure>| failure.map(|failure| (failure.kind(), failure.to_string())).unwrap();
    let named = |solver: &str| MethodOptions { solver: solver.to_owned(), ..MethodOptions::default() };
    let unknown = failed(fit(Path::new("grid.csv"), &named("surogate"), &|_| {}).err());
    assert!(unknown.0 == FailureKind::Usage && unknown.1.ends_with("; did you mean surrogate?"), "{unknown:?}");
    let options = |recipe: &str| RunOptions { recipe: recipe.into(), ..RunOptions::default() };
    let missing = failed(begin(&options("no.toml")).err());
    assert!(missing.0 == FailureKind::Usage && missing.1.contains("no.toml") && missing.1.contains("\nhelp: give an"));
    // a real rig that no option names needs a person, and here is none
    let folder = tempfile::tempdir().unwrap();
    let recipe = folder.path().join("recipe.toml");
    std::fs::write(&recipe, include_str!("../../recipes/paper.toml")).unwrap();
    std::fs::write(folder.path().join("rig.toml"), include_str!("../../rigs/esp301.toml")).unwrap();
    let real = failed(begin(&options(recipe.to_str().unwrap())).err());
    assert!(
        real.0 == FailureKind::Usage && real.1.contains("no terminal") && real.1.contains("help: add --rig"),
        "{real:?}"
    );
}

#[test]
fn values_that_the_command_line_refuses_are_refused() {
    let refused = |options: RunOptions| begin(&options).err().unwrap().to_string();
    let paper = || RunOptions { recipe: "paper".into(), ..RunOptions::default() };
    let labels = LabelOptions { note: Some("\u{7}".to_owned()), ..LabelOptions::default() };
    assert!(refused(RunOptions { labels, ..paper() }).contains("'--note': expected 1 to"));
    let rig = RigOptions { presses_max: Some(0), ..RigOptions::default() };
    assert!(refused(RunOptions { rig, ..paper() }).contains("'--presses-max': expected a whole number"));
    let manner = MannerOptions { pace: Some(-1.0), ..MannerOptions::default() };
    assert!(refused(RunOptions { manner, ..paper() }).contains("'--pace': expected a number above 0"));
    let method = MethodOptions { false_alarms: 2.0, ..MethodOptions::default() };
    assert!(method.check().unwrap_err().to_string().contains("'--false-alarms': expected a number between"));
    let method = MethodOptions { forces_n: vec![1.0], ..MethodOptions::default() };
    assert!(method.check().is_err());
    assert!(choice::<DurabilityChoice>("--durability", "ful").is_err() && strategy("brutal").is_err());
}

/// Returns the options of a command line without options.
fn parsed<T: clap::Args>(words: &[&str]) -> T {
    let command = T::augment_args(clap::Command::new("palpate").no_binary_name(true));
    T::from_arg_matches(&command.try_get_matches_from(words).unwrap()).unwrap()
}

#[test]
fn defaults_are_those_of_the_command_line() {
    let same = |left: String, right: String| assert_eq!(left, right);
    same(
        format!("{:?}", parsed::<RunOptions>(&["a"])),
        format!("{:?}", RunOptions { recipe: "a".into(), ..RunOptions::default() }),
    );
    same(
        format!("{:?}", parsed::<ResumeOptions>(&["a"])),
        format!("{:?}", ResumeOptions { run: "a".into(), ..ResumeOptions::default() }),
    );
    same(format!("{:?}", parsed::<MethodOptions>(&[])), format!("{:?}", MethodOptions::default()));
    same(format!("{:?}", parsed::<SolveOptions>(&[])), format!("{:?}", SolveOptions::default()));
    same(format!("{:?}", parsed::<EvaluateOptions>(&[])), format!("{:?}", EvaluateOptions::default()));
    same(format!("{:?}", parsed::<ReportOptions>(&["a"])), format!("{:?}", ReportOptions::of(vec!["a".into()])));
    let certificate = CertificateOptions { runs: vec!["a".into()], ..CertificateOptions::default() };
    same(format!("{:?}", parsed::<CertificateOptions>(&["a"])), format!("{certificate:?}"));
}
