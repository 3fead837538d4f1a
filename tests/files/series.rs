//! Raw series: every reading once, in order, with its time; a run that is killed loses none of a recorded press.

use palpate_core::quantity::stream;
use palpate_data::dataset::{Manifest, Recorded, RecordedSeries, SERIES};
use palpate_testing::executions::rig_without_load_cell;
use palpate_testing::interrupted::{cut_to_lines, lines_before_contacts};
use palpate_testing::{Live, TestFolder, campaign, shipped_text, there};
use rand::RngExt;
use std::fs;
use std::path::Path;
#[cfg(unix)]
use std::process::Command;

/// Kills: quick and full.
const KILLS: (usize, usize) = (5, 200);

/// Presses of the recipe below.
const PRESSES: usize = 9;

fn recipe(series: &str, press: &str) -> String {
    format!(
        "name = \"r\"\nrig = \"rig.toml\"\nchecks = \"none\"\n[record]\nseries = \"{series}\"\n[press]\n{press}\n[[step]]\n\
         phase = \"calibration\"\ngrid = {{ x_mm = [-2, 2], y_mm = [-2, 2], spacing_mm = 2.0 }}\nforce_n = 1.0\n"
    )
}

/// A folder with the shipped rig, and a recipe that keeps these readings.
fn bench(series: &str) -> TestFolder {
    TestFolder::with([("rig.toml", shipped_text("rigs/sim.toml").as_str()), ("r.toml", &recipe(series, ""))])
}

/// Columns of all readings of a run, with the number of the press as the first.
struct Columns {
    names: Vec<String>,
    values: Vec<Vec<f64>>,
}

impl Columns {
    fn of(run: &Path) -> Columns {
        let mark = Recorded::read(run).unwrap().series.expect("readings are kept");
        assert_eq!(fs::metadata(run.join(SERIES)).unwrap().len(), mark.bytes, "nothing follows the last press");
        let series = RecordedSeries::open(run, mark.bytes).unwrap();
        let names: Vec<String> = series.columns().iter().map(|column| column.name.clone()).collect();
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
        for batch in series {
            let batch = batch.unwrap();
            values[0].extend(batch.press.iter().map(|press| *press as f64));
            values[1..].iter_mut().zip(batch.numbers).for_each(|(all, more)| all.extend(more));
        }
        Columns { names, values }
    }

    fn column(&self, name: &str) -> &[f64] {
        &self.values[self.names.iter().position(|column| column == name).expect("a column")]
    }

    /// Mean of a column over the readings of a press that have a value.
    fn mean(&self, name: &str, press: f64) -> f64 {
        let its = self.column("press").iter().zip(self.column(name));
        let its: Vec<f64> =
            its.filter(|(of, value)| **of == press && !value.is_nan()).map(|(_, value)| *value).collect();
        its.iter().sum::<f64>() / its.len() as f64
    }

    /// Presses in the order of their readings, each once if its readings follow each other.
    fn presses(&self) -> Vec<f64> {
        let mut presses = self.column("press").to_vec();
        presses.dedup();
        presses
    }

    fn assert_times_increase(&self) {
        let [t_s, taken_s] = ["t_s", "taken_s"].map(|name| self.column(name));
        assert!(t_s.windows(2).all(|pair| pair[0] <= pair[1]));
        let taken: Vec<f64> = taken_s.iter().copied().filter(|taken_s| !taken_s.is_nan()).collect();
        assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "a force twice");
        assert!(t_s.iter().zip(taken_s).all(|(t_s, taken_s)| taken_s.is_nan() || *taken_s <= t_s + 1e-9));
    }
}

#[test]
fn presses_are_the_same_with_readings_and_are_their_means() {
    let presses = |series: &str| {
        let bench = bench(series);
        bench.palpate_ends(0, "run r.toml --out run --seed 3");
        (bench.read("run/presses.csv"), bench)
    };
    let ((none, _), (window, bench), (press, whole)) = (presses("none"), presses("window"), presses("press"));
    assert!(none == window && none == press, "readings change nothing");
    let columns = Columns::of(&bench.path("run"));
    columns.assert_times_increase();
    let mut reader = csv::Reader::from_reader(window.as_bytes());
    let header = reader.headers().unwrap().clone();
    for row in reader.records().map(Result::unwrap) {
        let cell =
            |name: &str| -> f64 { row[header.iter().position(|column| column == name).unwrap()].parse().unwrap() };
        let number = cell("press");
        // the zero of a force is interpolated between the readings without load before and after
        let moved_n = (cell("air_after_n") - cell("air_before_n")).abs();
        assert!((columns.mean("force_n", number) - cell("force_n")).abs() <= moved_n + 1e-6, "press {number}");
        assert!((columns.mean("out_5", number) - cell("out_5")).abs() < 1e-6, "press {number}");
    }
    let columns = Columns::of(&whole.path("run"));
    columns.assert_times_increase();
    let deepest_mm = columns.column("z_mm").iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!(columns.presses().len() == PRESSES && deepest_mm > 0.1, "{deepest_mm}");
}

/// A scene without noise relaxes at rest with one known time constant, which the times of the readings show.
#[test]
fn times_of_readings_show_the_time_constant_of_the_scene() {
    let rig = shipped_text("rigs/sim.toml");
    let mut document: toml_edit::DocumentMut = rig.parse().unwrap();
    let scene = document["scene"].as_table_mut().unwrap();
    let relaxation: toml_edit::Value = "[{ share = 0.3, time_s = 5.0 }]".parse().unwrap();
    scene["relaxation"] = toml_edit::value(relaxation);
    for key in ["noise_n", "drift_n_min", "quantum_n"] {
        if let Some(cell) = scene.get_mut("load_cell").and_then(toml_edit::Item::as_table_like_mut) {
            cell.remove(key);
        }
    }
    let bench = TestFolder::with([
        ("rig.toml", document.to_string().as_str()),
        ("r.toml", &recipe("press", "hold_s = 20.0\nstrategy = \"guarded\"")),
    ]);
    bench.palpate_ends(0, "run r.toml --out run");
    let columns = Columns::of(&bench.path("run"));
    let rows = columns.column("press").iter().zip(columns.column("t_s")).zip(columns.column("force_n"));
    let first: Vec<(f64, f64)> = rows
        .filter(|((press, _), force_n)| **press == 0.0 && **force_n > 0.5)
        .map(|((_, t_s), force_n)| (*t_s, *force_n))
        .collect();
    // forces at three equally distant times of the hold, each a mean of 100 readings
    let end_s = first[first.len() - 1].0 - 1.0;
    let at = |from_s: f64| {
        let near: Vec<f64> =
            first.iter().filter(|(t_s, _)| (t_s - from_s).abs() < 0.25).map(|(_, force_n)| *force_n).collect();
        near.iter().sum::<f64>() / near.len() as f64
    };
    let [a, b, c] = [end_s - 14.0, end_s - 8.0, end_s - 2.0].map(at);
    let time_s = 6.0 / ((a - b) / (b - c)).ln();
    assert!((time_s - 5.0).abs() < 0.05, "{time_s} s");
}

#[test]
fn changed_short_and_missing_files_are_named_before_anything_moves() {
    let bench = bench("press");
    bench.palpate_ends(0, "run r.toml --out run");
    let path = bench.path("run").join(SERIES);
    let sound = fs::read(&path).unwrap();
    let verified = |bytes: Option<&[u8]>| {
        match bytes {
            Some(bytes) => fs::write(&path, bytes).unwrap(),
            None => fs::remove_file(&path).unwrap(),
        }
        bench.palpate_ends(1, "verify run").running()
    };
    let mut changed = sound.clone();
    changed[10_000] ^= 1;
    let cut = &sound[..sound.len() - 100];
    let text = verified(Some(&changed));
    assert!(text.contains("series.arrows has changed since press 0 was recorded (SHA-256 differs)"), "{text}");
    let expected = format!("series.arrows ends at byte {}, within press 8", cut.len());
    assert!(verified(Some(cut)).contains(&expected));
    let longer = [sound.as_slice(), b"x"].concat();
    assert!(verified(Some(&longer)).contains("series.arrows has 1 bytes after the last press"));
    fs::write(&path, cut).unwrap();
    let refused = bench.palpate_ends(2, "rebuild run").running();
    let expected = format!("series.arrows has {} bytes; the journal states {}", cut.len(), sound.len());
    assert!(refused.contains(&expected), "{refused}");
    assert!(verified(None).contains("series.arrows is missing"));
    let exported = bench.palpate_ends(0, "export run --format csv --out csv").running();
    assert!(exported.contains("the table `series` was left out") && bench.has("csv/presses.csv"), "{exported}");
    fs::write(&path, &sound).unwrap();
    bench.palpate_ends(0, "verify run");
}

#[test]
fn series_needs_a_load_cell() {
    let by_depth = recipe("press", "").replace("force_n = 1.0", "depth_mm = 0.3");
    let bench = TestFolder::with([("rig.toml", rig_without_load_cell().as_str()), ("r.toml", &by_depth)]);
    let refused = bench.palpate_ends(2, "check r.toml").running();
    assert!(refused.contains("`series` needs a load cell, and this rig has none"), "{refused}");
}

/// A limit of the size of files stands for a full disk: the journal stays below it.
#[cfg(unix)]
#[test]
fn full_disk_ends_the_run_in_the_clear_and_it_is_continued() {
    let bench = bench("press");
    let program = bench.command("run r.toml --out run --json");
    let mut limited = Command::new("sh");
    let script = "trap '' XFSZ; ulimit -f 1400; exec \"$0\" \"$@\"";
    limited.args(["-c", script]).arg(program.get_program()).args(program.get_args());
    limited.envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let output = there(limited.current_dir(bench.path("")), "sh");
    let err = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{err}");
    assert!(err.contains("series.arrows: File too large") && err.contains("palpate resume"), "{err}");
    let done = Manifest::read(&bench.path("run/manifest.json")).unwrap().presses_done;
    assert!((1..PRESSES as u64).contains(&done), "{done}");
    bench.palpate_ends(0, "resume run");
    bench.palpate_ends(0, "verify run");
    assert_eq!(Columns::of(&bench.path("run")).presses().len(), PRESSES);
}

#[test]
fn readings_of_a_press_that_was_not_recorded_are_cut_off() {
    let bench = bench("press");
    bench.palpate_ends(0, "run r.toml --out run");
    let lines = lines_before_contacts(&bench, "run");
    for kept in [0, 1, 5] {
        let series = fs::read(bench.path("run").join(SERIES)).unwrap();
        cut_to_lines(&bench, "run", lines + kept);
        fs::write(bench.path("run").join(SERIES), series).unwrap();
        bench.palpate_ends(0, "resume run");
        bench.palpate_ends(0, "verify run");
        assert_eq!(Columns::of(&bench.path("run")).presses().len(), PRESSES, "{kept} presses were kept");
    }
}

#[test]
fn killed_run_keeps_the_readings_of_every_recorded_press_once() {
    let (wanted, mut kills, mut trial) = (campaign::size(KILLS.0, KILLS.1), 0, 0);
    while kills < wanted {
        trial += 1;
        let bench = bench("press");
        let mut rng = stream(1, trial, "kills of series");
        let mut words = "run r.toml --out run --json".to_owned();
        for _ in 0..2 {
            let mut live = Live::start(bench.command(&words));
            let mut lines = rng.random_range(0..PRESSES + 4);
            while lines > 0 && live.line().is_some() {
                lines -= 1;
            }
            live.kill();
            kills += 1;
            if !bench.has("run") {
                break;
            }
            words = "resume run --json".to_owned();
        }
        if !bench.has("run") {
            continue;
        }
        bench.palpate_ends(0, "resume run");
        bench.palpate_ends(0, "verify run");
        let columns = Columns::of(&bench.path("run"));
        let mut presses = columns.presses();
        presses.sort_by(f64::total_cmp);
        assert_eq!(presses, (0..PRESSES).map(|press| press as f64).collect::<Vec<_>>(), "trial {trial}");
        columns.assert_times_increase();
        assert_eq!(Manifest::read(&bench.path("run/manifest.json")).unwrap().presses_done, PRESSES as u64);
    }
    println!("{kills} kills");
}
