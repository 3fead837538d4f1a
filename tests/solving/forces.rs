//! Force vectors without a place: `evaluate --folds-by` on a table, and on the same table imported.

use palpate_core::quantity::stream;
use palpate_testing::TestFolder;
use rand::RngExt;

const COLUMNS: &str = "force_x_n=Fx,force_y_n=Fy,force_n=Fz,outputs=a..c";

/// A taxel with three outputs, whose response bends and whose gain differs from trial to trial.
fn table() -> String {
    let mut rng = stream(3, 0, "a table of forces");
    let mut within = |most: f64| rng.random_range(-most..most);
    let mut text = "trial,Fx,Fy,Fz,a1,a2,a3\n".to_owned();
    for row in 0..240 {
        let (x, y, z, trial) = (within(0.5), within(0.5), 1.0 + within(1.0), row / 60);
        let gain = 1.0 + 0.02 * f64::from(trial);
        let outputs = [x + 0.2 * z, y - 0.1 * z, z + 0.3 * z * z].map(|output| gain * output + within(0.01));
        let [a, b, c] = outputs;
        text += &format!("t{trial},{x},{y},{z},{a},{b},{c}\n");
    }
    text
}

fn bench() -> TestFolder {
    TestFolder::with([("table.csv", table().as_str())])
}

#[test]
fn groups_of_a_table_and_of_its_import_are_left_out_alike() {
    let columns = COLUMNS.replace("a..c", "a1..a3");
    let bench = bench();
    let of_table = bench.palpate_ends(0, &format!("evaluate table.csv --columns {columns} --folds-by trial"));
    assert!(of_table.out.contains("240 rows, left out in 4 parts (groups by `trial`)"), "{}", of_table.out);
    assert!(of_table.out.lines().all(|line| line.chars().count() <= 80), "{}", of_table.out);
    bench.palpate_ends(0, &format!("import table.csv --columns {columns},group=trial --out run"));
    let of_run = bench.palpate_ends(0, "evaluate run --folds-by trial");
    assert_eq!(of_run.out, of_table.out);
    let json = bench.palpate_ends(0, "evaluate run --json").out;
    let rmse_n = |method: usize, component: usize| {
        let value: serde_json::Value = serde_json::from_str(&json).unwrap();
        value["methods"][method]["components"][component]["rmse_n"].as_f64().unwrap()
    };
    for component in 0..3 {
        let least = (1..5).map(|method| rmse_n(method, component)).fold(f64::INFINITY, f64::min);
        assert!(rmse_n(0, component) < 1.05 * least && least > 0.0, "{json}");
    }
    bench.palpate_ends(0, "verify run");
}

#[test]
fn what_names_no_groups_or_no_forces_is_refused() {
    let columns = COLUMNS.replace("a..c", "a1..a3");
    let bench = bench();
    bench.palpate_ends(0, &format!("import table.csv --columns {columns} --out run"));
    // one row of another trial
    bench.write("few.csv", &bench.read("table.csv").lines().take(62).collect::<Vec<_>>().join("\n"));
    for (line, text) in [
        (format!("evaluate table.csv --columns {columns} --folds-by trail"), "column `trail` is missing"),
        (
            format!("evaluate table.csv --columns {columns},group=Fx --folds-by trial --holdout press 20%"),
            "cannot be used with",
        ),
        ("evaluate run --folds-by trial".to_owned(), "this run has no groups"),
        (
            format!("evaluate table.csv table.csv --columns {columns} --folds-by trial"),
            "leaves out groups of one table or run",
        ),
        (format!("evaluate table.csv --columns {columns} --accept none.toml"), "none.toml"),
        (format!("evaluate table.csv --columns x_mm=X,{columns} --folds-by trial"), "column `X` is missing"),
        (format!("evaluate few.csv --columns {columns} --folds-by trial"), "also without each group"),
        (format!("fit table.csv --columns {columns} --out model.palpate"), "240 calibration presses at 1 place"),
    ] {
        let refused = bench.palpate_ends(2, &line);
        let words = refused.err.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
        assert!(words.contains(text), "{line}: {words}");
    }
    let blocks = bench.palpate_ends(0, "evaluate run").out;
    assert!(blocks.contains("left out in 5 parts (in their order)"), "{blocks}");
}
