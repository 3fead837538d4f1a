//! A run with drags on a load cell of three axes: `evaluate --vector` solves its places and force vectors.

use crate::serve::Server;
use palpate_testing::executions::rig_with_drags;
use palpate_testing::{TestFolder, campaign, exchanged};

/// Places along each side of the calibration.
const SIDE: (usize, usize) = (5, 25);
const TESTS: (usize, usize) = (20, 500);

/// Repeatability and hysteresis of the shipped rig, % of its full scale of 2 N, and the same of the 3 N that drags need.
const OF_FULL_SCALE: [(&str, &str); 2] = [
    (
        "[1.60, 3.74, 2.19, 0.83, 0.51, 1.02, 0.71, 2.84, 3.97]",
        "[1.07, 2.49, 1.46, 0.55, 0.34, 0.68, 0.47, 1.89, 2.65]",
    ),
    (
        "[4.11, 2.29, 2.88, 3.08, 3.39, 5.53, 3.99, 4.44, 5.19]",
        "[2.74, 1.53, 1.92, 2.05, 2.26, 3.69, 2.66, 2.96, 3.46]",
    ),
];

fn rig() -> String {
    OF_FULL_SCALE.iter().fold(rig_with_drags(), |rig, (of_2_n, of_3_n)| exchanged(&rig, of_2_n, of_3_n))
}

fn recipe(side: usize, tests: usize) -> String {
    let spacing = 10.0 / (side - 1) as f64;
    format!(
        "name = \"vectors\"\nchecks = \"none\"\n[press]\nhold_s = 0.0\n\n[[step]]\nphase = \"calibration\"\n\
         grid = {{ x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], spacing_mm = {spacing} }}\nforce_n = 1.0\n\
         drag = {{ mm = 0.45, shear_n = 0.4, directions_deg = [0, 90, 180, 270] }}\n\n[[step]]\nphase = \"test\"\n\
         random = {{ count = {tests}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\nforce_n = 1.0\n\
         drag = {{ mm = 0.4, shear_n = 0.3, directions_deg = [45] }}\n"
    )
}

#[test]
fn a_run_with_drags_gives_places_and_force_vectors() {
    let (side, tests) = (campaign::size(SIDE.0, SIDE.1), campaign::size(TESTS.0, TESTS.1));
    let (rig, recipe) = (rig(), recipe(side, tests));
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("vectors.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run vectors.toml --rig rig.toml --simulate --out run --evaluate recipe");
    let out = bench.palpate_ends(0, "evaluate run --vector").out;
    println!("{side} x {side} places\n{out}");
    assert!(out.lines().all(|line| line.chars().count() <= 80), "{out}");
    let errors: serde_json::Value =
        serde_json::from_str(&bench.palpate_ends(0, "evaluate run --vector --json").out).unwrap();
    let number = |key: &str, at: usize| errors[key][at].as_f64().unwrap();
    // before the drag and after it
    assert_eq!((errors["presses"].as_u64(), errors["unsolved"].as_u64()), (Some(2 * tests as u64), Some(0)));
    let is_whole = side == SIDE.1;
    let most = if is_whole { [0.06, 0.012, 0.045] } else { [0.2, 0.05, 0.16] };
    for (key, most) in ["location_mm", "press_n", "shear_n"].into_iter().zip(most) {
        assert!(number(key, 0) <= most, "{key}: {errors}");
    }
    for component in errors["within"].as_array().unwrap().iter().filter(|_| is_whole) {
        let [in_68, in_95] = [0, 1].map(|level| component[level].as_f64().unwrap());
        assert!((0.60..=0.78).contains(&in_68) && (0.92..=0.985).contains(&in_95), "{errors}");
    }
    // pairs of test presses, added
    let pairs = errors["two_contacts"].as_array().unwrap();
    let far = pairs.last().unwrap();
    let least = if is_whole { 0.95 } else { 0.8 };
    assert!(far["from_mm"] == 8.0 && far["right"].as_f64().unwrap() >= least, "{errors}");
    let sum =
        |row: &serde_json::Value| ["right", "not_separable", "wrong", "one"].map(|key| row[key].as_f64().unwrap());
    assert!(pairs.iter().all(|row| (sum(row).iter().sum::<f64>() - 1.0).abs() < 1e-9), "{errors}");
    // the presses alone are solved as on a rig with one axis
    bench.palpate_ends(0, "evaluate run --solver surrogate");
}

#[test]
fn a_run_without_forces_sideways_is_refused() {
    let bench = TestFolder::with([("small.toml", palpate_testing::SMALL)]);
    bench.palpate_ends(0, "run small.toml --rig sim --out run --evaluate recipe");
    let refused = bench.palpate_ends(2, "evaluate run --vector");
    assert!(refused.err.contains("no press of the calibration has three"), "{}", refused.err);
}

/// Readings of the test windows of a run, and the same with the outputs of two presses added, or without a unit.
#[test]
fn solve_answers_with_a_force_vector_with_two_contacts_and_with_a_broken_unit() {
    let (rig, recipe) = (rig(), recipe(SIDE.0 + 2, TESTS.0));
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("vectors.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run vectors.toml --rig rig.toml --simulate --out run --evaluate recipe");
    let (head, rows) = bench.table("run/presses.csv");
    let at = |name: &str| head.iter().position(|column| column == name).unwrap();
    let number = |row: &Vec<String>, name: &str| row[at(name)].parse::<f64>().unwrap();
    let tests: Vec<&Vec<String>> = rows.iter().filter(|row| row[at("phase")] == "test").collect();
    let outputs = |row: &Vec<String>| -> Vec<f64> { (1..=27).map(|i| number(row, &format!("out_{i}"))).collect() };
    let solve = |readings: &[Vec<f64>]| {
        let line = |reading: &Vec<f64>| reading.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
        let text: String = readings.iter().map(line).collect();
        let solved = bench.palpate_reads("solve --vector --calibration run --json", &text);
        assert_eq!(solved.code, Some(0), "{}", solved.err);
        solved.json_lines()
    };
    // windows before a drag, some of whose places are far apart
    let still: Vec<&&Vec<String>> = tests.iter().filter(|row| number(row, "drag_mm") == 0.0).collect();
    let distance = |a: &Vec<String>, b: &Vec<String>| {
        (number(a, "x_mm") - number(b, "x_mm")).hypot(number(a, "y_mm") - number(b, "y_mm"))
    };
    let far = still.windows(2).filter(|pair| distance(pair[0], pair[1]) > 5.0);
    let far = far.map(|pair| outputs(pair[0]).iter().zip(outputs(pair[1])).map(|(a, b)| a + b).collect());
    let without = |row: &&&Vec<String>| {
        let mut outputs = outputs(row);
        outputs[12..15].fill(0.0); // the unit in the middle
        outputs
    };
    let mut readings: Vec<Vec<f64>> = tests.iter().map(|row| outputs(row)).chain(far).collect();
    let pairs_end = readings.len();
    readings.extend(still.iter().map(without));
    let answers = solve(&readings);
    let (one, two, broken) = (&answers[..tests.len()], &answers[tests.len()..pairs_end], &answers[pairs_end..]);
    let ok = one.iter().filter(|answer| answer["verdict"] == "ok").count();
    assert!(10 * ok >= 8 * one.len(), "{ok} of {}: {one:?}", one.len());
    let off = |(answer, row): (&serde_json::Value, &&Vec<String>)| {
        ["force_x_n", "force_y_n", "force_n"].map(|name| (answer[name].as_f64().unwrap() - number(row, name)).abs())
    };
    let pairs: Vec<[f64; 3]> =
        one.iter().zip(&tests).filter(|(answer, _)| answer["verdict"] == "ok").map(off).collect();
    for axis in 0..3 {
        let mean = pairs.iter().map(|off| off[axis]).sum::<f64>() / pairs.len() as f64;
        assert!(mean < 0.05, "{axis}: {mean} N");
    }
    let named = two.iter().filter(|answer| answer["verdict"] == "two-contacts").count();
    assert!(10 * named >= 8 * two.len() && two.len() > 5, "{named} of {}: {two:?}", two.len());
    let labelled = "id,t_s,".to_owned() + &(1..=27).map(|i| format!("out_{i}")).collect::<Vec<_>>().join(",");
    let reading = outputs(tests[0]).iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let csv = bench.palpate_reads("solve --vector --calibration run", &format!("{labelled}\n\"a,b\",0.5,{reading}\n"));
    assert!(csv.out.starts_with("id,t_s,x_mm,") && csv.out.contains("\n\"a,b\",0.5,"), "{}", csv.out);
    let named = broken.iter().filter(|answer| answer["verdict"] == "unit-fault" && answer["unit"] == 5).count();
    assert!(10 * named >= 6 * broken.len(), "{named} of {}: {broken:?}", broken.len());
    a_sensor_file_gives_the_same_answers(&bench, &readings, &answers);
    // the same contacts if the outputs of this unit are missing, and a reading without a contact
    let text = |outputs: &Vec<f64>, missing: std::ops::Range<usize>| {
        let cell = |(i, value): (usize, &f64)| if missing.contains(&i) { "nan".to_owned() } else { value.to_string() };
        outputs.iter().enumerate().map(cell).collect::<Vec<_>>().join(",") + "\n"
    };
    let lines: String =
        still.iter().map(|row| text(&outputs(row), 12..15)).chain([text(&vec![1e-4; 27], 0..0)]).collect();
    let answers = bench.palpate_reads("solve --model s.palpate --json", &lines).json_lines();
    assert_eq!(answers.last().unwrap()["verdict"], "weak-signal");
    let near = |(answer, row): (&serde_json::Value, &&&Vec<String>)| {
        let off_mm = |name: &str| answer[name].as_f64().unwrap() - number(row, name);
        answer["verdict"] == "ok" && off_mm("x_mm").hypot(off_mm("y_mm")) < 0.5
    };
    let near = answers.iter().zip(&still).filter(|pair| near(*pair)).count();
    assert!(10 * near >= 8 * still.len(), "{near} of {}: {answers:?}", still.len());
}

/// Fits the run to a sensor file, which `solve` and `serve` use, and which other commands refuse.
fn a_sensor_file_gives_the_same_answers(bench: &TestFolder, readings: &[Vec<f64>], answers: &[serde_json::Value]) {
    let fitted = bench.palpate_ends(0, "fit run --vector --out s.palpate");
    assert!(fitted.err.contains("force-vector, fitted to "), "{}", fitted.err);
    let line = |reading: &Vec<f64>| reading.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
    let text: String = readings.iter().map(line).collect();
    assert_eq!(bench.palpate_reads("solve --model s.palpate --json", &text).json_lines(), answers);
    let served = Server::start(bench, "--model s.palpate --json").answers(text.as_bytes());
    let numbered = served.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let without_line = numbered.map(|mut answer| {
        answer.as_object_mut().unwrap().remove("line");
        answer
    });
    assert!(without_line.eq(answers.iter().cloned()), "{served}");
    let kept = bench.palpate_reads("solve --model s.palpate --keep-going", &format!("1,2\n{}", line(&readings[0])));
    assert!(kept.out.starts_with("line,id,t_s,x_mm,") && kept.out.contains("\n1,,,,"), "{}", kept.out);
    // the run's own table gives the same model, and a changed second line is noticed
    bench.palpate_ends(0, "fit run/presses.csv --vector --out t.palpate");
    let [run, table] = ["s.palpate", "t.palpate"].map(|file| std::fs::read(bench.path(file)).unwrap());
    let card = |bytes: &[u8]| {
        serde_json::from_slice::<serde_json::Value>(bytes.split(|byte| *byte == b'\n').nth(1).unwrap()).unwrap()
    };
    assert_eq!(card(&run)["valid"]["presses"], card(&table)["valid"]["presses"]);
    let at = run.windows(14).position(|bytes| bytes == b"\"force-vector\"").unwrap();
    std::fs::write(bench.path("changed.palpate"), [&run[..at], b"\"force-vecuor\"", &run[at + 14..]].concat()).unwrap();
    let changed = bench.palpate_ends(2, "solve --model changed.palpate");
    assert!(changed.err.contains("changed.palpate is damaged"), "{}", changed.err);
    bench.palpate_ends(0, "fit run --vector --false-alarms 0.2 --out often.palpate");
    let often = bench.palpate_reads("solve --model often.palpate --json", &text).json_lines();
    let ok = |answers: &[serde_json::Value]| answers.iter().filter(|answer| answer["verdict"] == "ok").count();
    assert!(ok(&often) < ok(answers), "more contacts are doubted");
    for refused in ["export --model s.palpate --format c", "adapt --from s.palpate --with run --out b.palpate"]
        .map(|words| bench.palpate_ends(2, words))
    {
        assert!(refused.err.contains("s.palpate solves force vectors; only"), "{}", refused.err);
    }
}
