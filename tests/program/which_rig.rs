//! The choice of the rig for a recipe; and no real stage moves unless `--rig` names the rig or a person confirms it.
#![cfg(unix)]

use palpate_testing::terminal::{TestTerminal, spawned, wait};
use palpate_testing::{CommandOutput, SMALL, TestFolder, exchanged, shipped_text};

/// A file that the programs of the real rig create: a real device was opened.
const OPENED: &str = "opened";

/// Place of a recipe's rig.
struct Layout {
    /// Words after `run`.
    words: &'static str,
    /// The recipe's file and text.
    recipe: (&'static str, fn() -> String),
    /// The file with the rig.
    rig: &'static str,
    /// The first line about the choice; `None`: there is no rig to choose.
    first: Option<&'static str>,
}

const LAYOUTS: [Layout; 8] = [
    Layout { words: "r.toml --rig a.toml", recipe: ("r.toml", unnamed), rig: "a.toml", first: Some("named by --rig") },
    Layout { words: "r.toml --rig a.toml", recipe: ("r.toml", keyed), rig: "a.toml", first: Some("named by --rig") },
    Layout {
        words: "sub/r.toml",
        recipe: ("sub/r.toml", keyed),
        rig: "sub/b.toml",
        first: Some("named by the recipe"),
    },
    Layout { words: "r.toml", recipe: ("r.toml", unnamed), rig: "rig.toml", first: Some("in the recipe's folder") },
    Layout { words: "r.toml", recipe: ("r.toml", shipped), rig: "rig.toml", first: Some("in the recipe's folder") },
    Layout { words: "batch", recipe: ("r.toml", unnamed), rig: "rig.toml", first: Some("shipped with palpate") },
    Layout { words: "r.toml", recipe: ("r.toml", shipped), rig: "sub/rig.toml", first: Some("shipped with palpate") },
    Layout { words: "r.toml", recipe: ("r.toml", unnamed), rig: "sub/rig.toml", first: None },
];

/// Who is present while the program runs.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WhichRigPerson {
    Nobody,
    Agrees,
    Refuses,
}

fn unnamed() -> String {
    exchanged(SMALL, "rig = \"sim\"\n", "")
}

fn keyed() -> String {
    exchanged(SMALL, "rig = \"sim\"\n", "rig = \"b.toml\"\n")
}

fn shipped() -> String {
    shipped_text("recipes/batch.toml")
}

/// A rig with programs that show their start, and end.
fn real() -> String {
    let text = shipped_text("rigs/process.toml").replace("\"examples/stage.py\"", "\"examples/load_cell.py\"");
    let text = text.replace("\"examples/array.py\", \"9\"", "\"examples/load_cell.py\"");
    text.replace("\"python3\", \"examples/load_cell.py\"", &format!("\"touch\", \"{OPENED}\""))
}

impl Layout {
    fn bench(&self, is_real: bool) -> TestFolder {
        let bench = TestFolder::new();
        std::fs::create_dir(bench.path("sub")).expect("makes");
        bench.write(self.recipe.0, &self.recipe.1());
        // a file that was the default once is never used
        std::fs::create_dir(bench.path("rigs")).expect("makes");
        bench.write("rigs/sim.toml", &real());
        bench.write(self.rig, &if is_real { real() } else { shipped_text("rigs/sim.toml") });
        bench
    }

    /// Whether the chosen rig is the real one.
    fn is_of_own(&self) -> bool {
        self.first.is_some_and(|first| first != "shipped with palpate")
    }
}

/// Runs the program, with a person at a terminal or without one.
fn run(bench: &TestFolder, words: &str, person: WhichRigPerson, is_asked: bool) -> CommandOutput {
    let mut command = bench.command(&format!("run {words} --out out"));
    if person == WhichRigPerson::Nobody {
        return command.output().expect("the program starts").into();
    }
    let mut terminal = TestTerminal::open();
    let child = spawned(command.stdin(terminal.far()).stdout(terminal.far()).stderr(terminal.far()));
    drop(command);
    let mut out = String::new();
    if is_asked {
        out = terminal.until("This rig is real. Use it? [y/N]");
        terminal.line(if person == WhichRigPerson::Agrees { "y" } else { "n" });
    }
    out += &terminal.until_end();
    CommandOutput { code: wait(child), err: out.clone(), out }
}

#[test]
fn no_real_stage_moves_without_the_option_or_a_person_who_confirms() {
    for layout in LAYOUTS {
        for is_real in [false, true] {
            for person in [WhichRigPerson::Nobody, WhichRigPerson::Agrees, WhichRigPerson::Refuses] {
                let bench = layout.bench(is_real);
                let is_real = is_real && layout.is_of_own();
                let is_asked = is_real && layout.first != Some("named by --rig");
                let output = run(&bench, layout.words, person, is_asked);
                let case = format!("run {}, {} {is_real} {person:?}: {output:?}", layout.words, layout.rig);
                let has = |part: &str| output.running().contains(part);
                let may_move = is_real && (!is_asked || person == WhichRigPerson::Agrees);
                assert_eq!(bench.has(OPENED), may_move, "{case}");
                let Some(first) = layout.first else {
                    assert!(
                        output.code == Some(2) && has("--rig RIG") && has("rig.toml") && has("rig = \"RIG\""),
                        "{case}"
                    );
                    continue;
                };
                let kind = if is_real { "real" } else { "simulated" };
                let line = output.out.lines().next().unwrap_or_default().trim_end();
                assert!(line.starts_with("rig ") && line.ends_with(&format!(": {kind}, {first}")), "{case}");
                match (is_real, may_move) {
                    (false, _) => assert!(matches!(output.code, Some(0 | 1)) && bench.has("out/presses.csv"), "{case}"),
                    (true, true) => assert_eq!(output.code, Some(3), "{case}"),
                    (true, false) => {
                        assert!(output.code == Some(2) && has("nothing was moved") && has("--rig"), "{case}")
                    }
                }
                assert!(may_move || !is_real || !bench.has("out"), "{case}");
            }
        }
    }
}

#[test]
fn check_and_a_dry_run_choose_the_same_rig() {
    for layout in LAYOUTS {
        for (is_real, more) in [(false, ""), (true, ""), (true, " --simulate")] {
            let bench = layout.bench(is_real);
            let check = bench.palpate(&format!("check {}{more}", layout.words));
            let dry = bench.palpate(&format!("run {}{more} --dry-run", layout.words));
            assert_eq!((&check.out, &check.err, check.code), (&dry.out, &dry.err, dry.code));
            assert!(!bench.has(OPENED) && !bench.has("runs"), "{check:?}");
            let is_real = is_real && more.is_empty() && layout.is_of_own();
            let kind = if is_real { ": real, " } else { ": simulated, " };
            match layout.first {
                Some(first) => assert!(
                    check.out.lines().next().is_some_and(|line| line.ends_with(&format!("{kind}{first}"))),
                    "{check:?}"
                ),
                None => assert_eq!(check.code, Some(2), "{check:?}"),
            }
        }
    }
}

#[test]
fn a_recipe_in_the_folder_of_its_run_is_refused() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out one");
    for words in ["run one/recipe.toml", "run one/recipe.toml --rig sim", "check one/recipe.toml"] {
        let output = bench.palpate_ends(2, words).running();
        assert!(output.contains("palpate resume one") && output.contains("copy the recipe"), "{output}");
    }
    assert!(!bench.has("runs"));
}

#[test]
fn a_recipe_of_a_batch_has_the_rig_of_the_batch() {
    let batch = "name = \"day\"\ndesign = \"pad\"\nrig = \"a.toml\"\nrecipes = [\"r.toml\"]\nserials = [\"A-01\"]\n";
    let sim = shipped_text("rigs/sim.toml");
    for (key, is_same) in [("a.toml", true), ("sim", true), ("printer", false)] {
        let recipe = exchanged(&shipped(), "name =", &format!("rig = \"{key}\"\nname ="));
        let bench = TestFolder::with([("batch.toml", batch), ("a.toml", sim.as_str()), ("r.toml", recipe.as_str())]);
        let output = bench.palpate_ends(if is_same { 0 } else { 2 }, "batch check batch.toml");
        let said = "r.toml: `rig` is printer.toml, but the rig of the batch is a.toml";
        assert_eq!(output.running().contains(said), !is_same, "{output:?}");
        assert!(!is_same || output.out.starts_with("rig a.toml: simulated, named by the batch\n"), "{output:?}");
    }
}
