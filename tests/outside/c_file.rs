//! A sensor as a C file: compiled by the system's compiler, it gives the answers of this library.

use palpate_core::quantity::{ArrayLayout, Place, RandomStream, percentile, stream};
use palpate_report::export::c_file;
use palpate_sim::scene::{Skin, SkinSpec};
use palpate_solver::{
    Calibration, CalibrationPoint, ContactVerdict, ForceKnown, Model, Setting, Solution, SolveError, Solver as _,
    Workspace,
};
use palpate_testing::skins::{scene_q, scene_t};
use palpate_testing::{campaign, there};
use rand::RngExt;
use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};

/// Reads readings, one on each line, and prints place, force, misfit, verdict and output.
const MAIN: &str = r#"
#define PALPATE_DECLARATIONS
#include "sensor.c"
#include <stdio.h>

int main(void)
{
    float outputs[PALPATE_OUTPUTS];
    struct palpate_contact contact;
    for (;;) {
        int i;
        for (i = 0; i < PALPATE_OUTPUTS; i++) {
            if (scanf("%f", &outputs[i]) != 1) return 0;
        }
        if (palpate_solve(outputs, &contact) != contact.verdict) return 1;
        printf("%.9g %.9g %.9g %.9g %d %d\n", contact.x_mm, contact.y_mm, contact.force_n, contact.misfit,
               contact.verdict, contact.unit);
    }
}
"#;

/// Answer of the C program.
struct Answer {
    place: Place,
    force_n: f64,
    misfit: f64,
    verdict: i32,
    output: usize,
}

/// Compiles a model and solves readings with it.
fn answers(folder: &Path, model: &Model, readings: &[Vec<f64>]) -> Vec<Answer> {
    fs::write(folder.join("sensor.c"), c_file(model, "a test */ int x;").unwrap()).unwrap();
    fs::write(folder.join("main.c"), MAIN).unwrap();
    let flags =
        ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "sensor.c", "main.c", "-o", "solve", "-lm"];
    let compiled = there(Command::new("cc").args(flags).current_dir(folder), "a C compiler that is called cc");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let text: String =
        readings.iter().map(|row| row.iter().map(|v| format!("{:e} ", *v as f32)).collect::<String>() + "\n").collect();
    fs::write(folder.join("readings"), text).unwrap();
    let input = File::open(folder.join("readings")).unwrap();
    let solved = Command::new(folder.join("solve")).stdin(Stdio::from(input)).output().unwrap();
    assert!(solved.status.success());
    let lines = String::from_utf8(solved.stdout).unwrap();
    let answer = |line: &str| {
        let numbers: Vec<f64> = line.split(' ').map(|number| number.parse().unwrap()).collect();
        let [x_mm, y_mm, force_n, misfit, verdict, output] = numbers[..] else { panic!("{line}") };
        Answer { place: Place::new(x_mm, y_mm), force_n, misfit, verdict: verdict as i32, output: output as usize }
    };
    lines.lines().map(answer).collect()
}

fn pressed(skin: &mut Skin, rng: &mut RandomStream, place: Place, force_n: f64) -> Vec<f64> {
    let mut outputs = vec![0.0; skin.len()];
    skin.draw_contact(rng);
    skin.outputs(force_n, place, &mut outputs);
    outputs
}

/// A calibration of 625 places, and readings of random contacts. `unit` multiplies all outputs, like another unit of measurement.
fn skin(spec: &SkinSpec, unit: f64, count: usize) -> (ArrayLayout, Calibration, Vec<Vec<f64>>) {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let (mut skin, mut rng) = (Skin::new(spec, &layout, 2.0, 5), stream(5, 1, "contacts"));
    let at = |index: usize| -6.0 + 0.5 * index as f64;
    let places: Vec<Place> = (0..625).map(|index| Place::new(at(index % 25), at(index / 25))).collect();
    let mut read = |place, force_n, rng: &mut RandomStream| -> Vec<f64> {
        pressed(&mut skin, rng, place, force_n).iter().map(|output| unit * output).collect()
    };
    let rows: Vec<Vec<f64>> = places.iter().map(|place| read(*place, 1.0, &mut rng)).collect();
    let points: Vec<CalibrationPoint<'_>> = (places.iter().zip(&rows))
        .map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs })
        .collect();
    let readings = (0..count).map(|_| {
        let [x_mm, y_mm] = [(); 2].map(|()| rng.random_range(-6.0..6.0));
        let force_n = rng.random_range(0.1..1.0);
        read(Place::new(x_mm, y_mm), force_n, &mut rng)
    });
    let readings = readings.collect();
    (layout, Calibration::new(&points).unwrap(), readings)
}

fn number(verdict: ContactVerdict) -> (i32, usize) {
    match verdict {
        ContactVerdict::Ok => (0, 0),
        ContactVerdict::WeakSignal => (1, 0),
        ContactVerdict::OutsideArea => (2, 0),
        ContactVerdict::NotOneContact => (3, 0),
        ContactVerdict::ChannelFault(unit) => (4, unit + 1),
    }
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn the_compiled_file_answers_as_the_library() {
    let count = campaign::size(1000, 10_000);
    let folder = tempfile::tempdir().unwrap();
    let counts = 1e5; // of a converter
    let cases = [
        ("T", scene_t(), 1.0, Setting::default()),
        ("Q", scene_q(), counts, Setting::default()),
        ("Q, constant load", scene_q(), 1.0, Setting { load: ForceKnown::Constant, ..Setting::default() }),
        ("T, common offset", scene_t(), 1e-6, Setting { common_offset: true, ..Setting::default() }),
    ];
    for (case, spec, unit, setting) in cases {
        let (layout, calibration, readings) = skin(&spec, unit, count);
        for method in ["pearson", "pearson-lsq", "surrogate", "physics"] {
            let setting = Setting { layout: Some(&layout), ..setting };
            let model = Model::fit(method, calibration.clone(), &setting).unwrap();
            let mut workspace = Workspace::default();
            let ours: Vec<Result<Solution, SolveError>> =
                readings.iter().map(|reading| model.fitted().solve(reading, &mut workspace)).collect();
            let theirs = answers(folder.path(), &model, &readings);
            let (mut apart_um, mut apart_mn, mut flips, mut verdicts) = (Vec::new(), Vec::new(), 0, 0);
            for (ours, theirs) in ours.iter().map(|ours| ours.as_ref().unwrap()).zip(&theirs) {
                apart_um.push(1e3 * ours.place.distance_mm(theirs.place));
                apart_mn.push(1e3 * (ours.force_n - theirs.force_n).abs());
                flips += usize::from(ours.place.distance_mm(theirs.place) > 0.1);
                verdicts += usize::from(number(ours.verdict) != (theirs.verdict, theirs.output));
            }
            assert_eq!(theirs.len(), count);
            assert!(theirs.iter().all(|answer| answer.misfit.is_finite()));
            [&mut apart_um, &mut apart_mn].into_iter().for_each(|apart| apart.sort_by(f64::total_cmp));
            let [um, mn] = [&apart_um, &apart_mn].map(|apart| percentile(apart, 0.99));
            println!(
                "{case}, {method}: 99 % within {um:.4} um and {mn:.4} mN; {flips} of {count} elsewhere, {verdicts} other verdicts"
            );
            assert!(um <= 1.0 && mn <= 0.1, "{case}, {method}: {um} um, {mn} mN");
            assert!(flips <= count / 500 && verdicts <= count / 500, "{case}, {method}: {flips} {verdicts}");
        }
    }
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn a_force_that_is_not_known_is_nan() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, calibration, readings) = skin(&scene_t(), 1.0, 20);
    let points: Vec<CalibrationPoint<'_>> = calibration.points().collect();
    let silent = Calibration::without_forces(&points).unwrap();
    for method in ["pearson", "surrogate"] {
        let model = Model::fit(method, silent.clone(), &Setting::of_layout(Some(&layout))).unwrap();
        let answers = answers(folder.path(), &model, &readings);
        assert!(answers.iter().all(|answer| answer.force_n.is_nan() && answer.place.x_mm.is_finite()), "{method}");
        assert!(c_file(&model, "a test").unwrap().contains("contact->relative_force = "));
    }
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn reading_without_contact_is_reported_and_missing_output_is_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, calibration, readings) = skin(&scene_t(), 1.0, 50);
    // unit 3 is dead in the calibration
    let rows: Vec<(Place, f64, Vec<f64>)> = (calibration.points())
        .map(|point| {
            let mut outputs = point.outputs.to_vec();
            outputs[2] = 0.5;
            (point.place, point.force_n, outputs)
        })
        .collect();
    let points: Vec<CalibrationPoint<'_>> = (rows.iter())
        .map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs })
        .collect();
    let dead = Calibration::new(&points).unwrap();
    let setting = Setting::of_layout(Some(&layout));
    for method in ["pearson", "surrogate"] {
        let model = Model::fit(method, dead.clone(), &setting).unwrap();
        let nothing = vec![0.0; 9];
        let not_a_number = vec![f64::NAN; 9];
        let all: Vec<Vec<f64>> = [nothing, not_a_number].into_iter().chain(readings.clone()).collect();
        let theirs = answers(folder.path(), &model, &all);
        assert_eq!(theirs[..2].iter().map(|answer| answer.verdict).collect::<Vec<i32>>(), [5, 5], "{method}");
        let mut workspace = Workspace::default();
        for (reading, theirs) in readings.iter().zip(&theirs[2..]) {
            let ours = model.fitted().solve(reading, &mut workspace).unwrap();
            assert!(ours.place.distance_mm(theirs.place) < 0.01, "{method}");
        }
    }
    let other = Model::fit("extra-trees", calibration, &setting).unwrap();
    let refusal = c_file(&other, "x").unwrap_err().to_string();
    assert_eq!(refusal, "`extra-trees` can't be exported as C: only pearson, pearson-lsq, surrogate and physics can");
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn a_compiler_without_nan_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (layout, calibration, _) = skin(&scene_t(), 1.0, 1);
    let model = Model::fit("pearson", calibration, &Setting::of_layout(Some(&layout))).unwrap();
    fs::write(folder.path().join("sensor.c"), c_file(&model, "a test").unwrap()).unwrap();
    for (flags, is_refused) in [
        ("-O3", false),
        ("-Ofast", true),
        ("-O2 -ffast-math", true),
        ("-O2 -ffinite-math-only", true),
        ("-O2 -ffast-math -fno-fast-math", false),
    ] {
        let words = ["-std=c99", "-c", "sensor.c", "-o", "sensor.o"];
        let compiled = there(
            Command::new("cc").args(flags.split(' ')).args(words).current_dir(folder.path()),
            "a C compiler that is called cc",
        );
        let said = String::from_utf8_lossy(&compiled.stderr);
        assert_eq!(compiled.status.success(), !is_refused, "{flags}: {said}");
        assert_eq!(said.contains("this file needs NAN and infinity"), is_refused, "{flags}: {said}");
    }
}
