//! Pages of sensors of every kind: a magnetic skin, one of 15 outputs, and the paper's own array. Only the last one has the paper's
//! numbers, on its page and in the output of `evaluate` and `run`.

use palpate_testing::printed::is_narrow;
use palpate_testing::skins::skins;
use palpate_testing::{SMALL, TestFolder, campaign, shipped_text};
use std::fs;
use std::path::Path;

#[test]
fn page_of_another_sensor_has_its_unit_and_no_paper() {
    let bench = skins();
    for (skin, channels, quick) in [("magnetic", &[""][..], "surrogate"), ("fifteen", &["-1", "-2", "-3"], "surrogate")]
    {
        bench.palpate_ends(0, &format!("report {skin} --figures {skin}-figures"));
        let page = bench.read(&format!("{skin}/report.html"));
        for word in ["paper", "Sensors 2018", "Table 1", "Figure 8", "Figure 9", "Figure 10"] {
            assert!(!page.to_lowercase().contains(&word.to_lowercase()), "{skin}: {word}");
        }
        assert!(page.contains(">output, µT<"), "{skin}");
        for volt in [" V<", ", V<", "V/N", " V;", " V,"] {
            assert!(!page.contains(volt), "{skin}: {volt}");
        }
        let units = if channels.len() > 1 { 5 } else { 16 };
        for channel in channels {
            let table = bench.read(&format!("{skin}-figures/output-by-place{channel}.csv"));
            assert!(table.starts_with("panel,x_mm,y_mm,output_ut\n"), "{}", &table[..60]);
            assert_eq!(table.lines().count(), 1 + 361 * units, "{skin}");
        }
        // `all` takes long, and has the lines of all methods for a few presses too: see below
        let solvers: &[&str] = if campaign::is_quick() { &[quick] } else { &["best", "all"] };
        for solver in solvers {
            let output = bench.palpate_ends(0, &format!("evaluate {skin} --solver {solver}")).out;
            assert!(
                !output.contains("paper") && !output.contains("0.46 mm") && !output.contains("Table 1"),
                "{output}"
            );
            is_narrow(&output);
        }
    }
}

#[test]
fn paper_numbers_are_shown_for_the_papers_protocol() {
    let bench = TestFolder::new();
    let output = bench.palpate_ends(0, "run paper").out;
    assert!(output.contains("location error, mean       0.46 mm"), "{output}");
    is_shown_in_the_book(&output);
    bench.palpate_ends(0, "report runs/paper");
    let page = bench.read("runs/paper/report.html");
    for cited in
        ["Liu, W.; Gu, C.; Zeng, R.; Yu, P.; Fu, X.", "A Novel Inverse Solution of Contact Force", "Sensors 2018"]
    {
        assert!(page.contains(cited), "{cited}");
    }
    assert!(page.contains("doi:10.3390/s18020351") && page.contains("<th scope=\"col\">paper</th>"));
    assert_eq!(page.matches("<th scope=\"col\">paper</th>").count(), 4, "errors, two repeatabilities, hysteresis");
    if campaign::is_quick() {
        let output = bench.palpate_ends(0, "evaluate runs/paper").out;
        assert!(output.lines().next().is_some_and(|header| header.trim_start().starts_with("paper ")), "{output}");
    } else {
        let output = bench.palpate_ends(0, "evaluate runs/paper --solver all").out;
        assert!(output.contains("\npaper "), "{output}");
    }
}

/// The picture of the README and the tutorial show what a run prints, except for its duration.
fn is_shown_in_the_book(output: &str) {
    let book = |path: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(path);
        fs::read_to_string(path).expect("a page of the book")
    };
    let (picture, tutorial) = (book("pictures/run.svg"), book("tutorials/simulation.md"));
    assert!(output.lines().count() <= 20, "{output}");
    for line in output.lines().filter(|line| !line.starts_with("time: ") && !line.is_empty()) {
        assert!(picture.contains(&format!(">{line}</text>")), "docs/pictures/make PROGRAM run.svg: {line}");
        assert!(tutorial.contains(&format!("\n{line}\n")), "the tutorial lacks {line}");
    }
}

#[test]
fn paper_numbers_are_absent_for_another_protocol() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out small");
    let output = bench.palpate_ends(0, "evaluate small --solver all").out;
    assert!(
        output.contains("\npearson ") && output.contains("\nextra-trees ") && !output.contains("paper"),
        "{output}"
    );
}

/// The same array with nearly the same protocol, and another array with the same one.
#[test]
fn any_other_protocol_is_shown_without_the_paper() {
    let bench = TestFolder::new();
    let recipe = shipped_text("recipes/paper.toml");
    let short = recipe
        .replace("repeats = 5, rest_s = 300.0", "repeats = 1, rest_s = 0.0")
        .replace("name = \"paper\"", "name = \"other\"");
    let rig = shipped_text("rigs/sim.toml");
    let wide = rig.replace("pitch_mm = 4.5", "pitch_mm = 4.6");
    let others = [
        ("force", short.replace("force_n = 1.0", "force_n = 0.9"), &rig),
        ("grid", short.replace("spacing_mm = 0.5", "spacing_mm = 0.6"), &rig),
        ("count", short.replace("count = 100", "count = 99"), &rig),
        ("light", short.replace("force_n = [0.1, 1.0]", "force_n = [0.2, 1.2]"), &rig),
        ("pitch", short.clone(), &wide),
    ];
    let every = campaign::every(others.len(), 1);
    for (name, recipe, rig) in others.into_iter().step_by(every) {
        assert!(recipe != short || *rig != shipped_text("rigs/sim.toml"), "{name} differs in nothing");
        bench.write("recipe.toml", &recipe);
        bench.write("rig.toml", rig);
        let output = bench.palpate(&format!("run recipe.toml --rig rig.toml --out {name}")).out;
        assert!(output.contains("location error, mean") && !output.contains("0.46 mm"), "{name}: {output}");
        bench.palpate(&format!("report {name}"));
        let page = bench.read(&format!("{name}/report.html"));
        assert!(!page.to_lowercase().contains("paper"), "{name}");
    }
}
