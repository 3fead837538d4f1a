//! Solutions written as lines.

use super::lines::{AnswerWriter, Lines};
use palpate_core::quantity::{Place, round};
use palpate_data::dataset::readings::Reading;
use palpate_solver::{ContactVerdict, Covariance, FaultyUnit, Fitted, HalfWidths, Model, Solution};
use serde::Serialize;
use serde_json::Value;
use std::error::Error;
use std::io::{self, Write};

/// Number of decimals in the output, the same as in a run's tables. It is far finer than the resolution of any array.
pub(super) const DECIMALS: i32 = 6;
/// Verdict on a reading without an answer.
pub const UNSOLVED: &str = "unsolved";

/// Writes contacts, a line each.
pub(crate) struct Solutions<W: Write> {
    lines: Lines<W>,
    /// Invalid lines are answered too: each answer has its line number, and CSV has a column for the problem.
    keep_going: bool,
    measure: Measure,
    /// Whether a second method answers readings with the load of the calibration.
    has_two_methods: bool,
}

/// What a model solves besides the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// The force, N.
    Force,
    /// The force, relative to the typical press of the calibration.
    RelativeForce,
    /// The depth, mm.
    Depth,
}

impl Measure {
    /// What this model solves.
    pub fn of(model: &Model) -> Self {
        match () {
            () if model.depths_are_known() => Measure::Depth,
            () if model.forces_are_known() => Measure::Force,
            () => Measure::RelativeForce,
        }
    }

    /// Whether answers have a number of [`NUMBERS`].
    pub fn has(self, number: &str) -> bool {
        match number {
            "force_n" | "sd_force_n" | "half68_n" | "half95_n" => self != Measure::Depth,
            number if number.contains("relative") => self == Measure::RelativeForce,
            number if number.contains("depth") => self == Measure::Depth,
            _ => true,
        }
    }
}

/// One line of output. Keys and columns are the same, and are always present unless marked as skipped.
#[derive(Serialize)]
struct SolutionLine<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<&'a Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    t_s: Option<&'a Value>,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    /// Force, its error and its half-widths. Not if depths are solved.
    #[serde(skip_serializing_if = "Option::is_none")]
    force_n: Option<Option<f64>>,
    /// Depth, its error and its half-widths. Only if depths are solved.
    #[serde(skip_serializing_if = "Option::is_none")]
    depth_mm: Option<Option<f64>>,
    sd_x_mm: Option<f64>,
    sd_y_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sd_force_n: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sd_depth_mm: Option<Option<f64>>,
    half68_mm: Option<f64>,
    half95_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half68_n: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half95_n: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half68_depth_mm: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half95_depth_mm: Option<Option<f64>>,
    /// Another place that explains the reading nearly as well.
    other_x_mm: Option<f64>,
    other_y_mm: Option<f64>,
    misfit: Option<f64>,
    /// Force relative to the typical press, and its half-widths. Only if the calibration has no forces.
    #[serde(skip_serializing_if = "Option::is_none")]
    relative_force: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half68_relative_force: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    half95_relative_force: Option<Option<f64>>,
    /// Which of two methods answered: the one for the load of the calibration, or the one for any load. Empty without an answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    load: Option<&'static str>,
    verdict: &'static str,
    unit: Option<usize>,
    /// Units that broke since the calibration and are left out, each with the odds to one that it is at fault.
    left_out: String,
    /// Why there is no contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl<W: Write> Solutions<W> {
    /// `measure` states what is solved besides the place.
    pub(crate) fn new(to: W, json: bool, keep_going: bool, measure: Measure) -> Self {
        Solutions { lines: Lines::new(to, json, keep_going), keep_going, measure, has_two_methods: false }
    }

    /// Adds a column that shows which of two methods answered, if the model has two.
    pub(crate) fn of_methods(self, fitted: &Fitted) -> Self {
        Solutions { has_two_methods: fitted.at_calibrated_load().is_some(), ..self }
    }
}

impl<W: Write> AnswerWriter<Solution> for Solutions<W> {
    fn write(
        &mut self,
        reading: &Reading,
        at_fault: &[FaultyUnit],
        solved: &Result<Solution, impl Error>,
    ) -> io::Result<()> {
        let load = solved.as_ref().map_or("", Solution::load);
        let [id, t_s] = self.lines.labels(reading);
        let line = SolutionLine {
            line: self.keep_going.then_some(reading.line),
            id,
            t_s,
            load: self.has_two_methods.then_some(load),
            left_out: at_fault
                .iter()
                .map(|FaultyUnit { unit, odds }| format!("{}:{odds}", unit + 1))
                .collect::<Vec<_>>()
                .join(" "),
            error: self.lines.error(solved, self.keep_going),
            ..SolutionLine::of(solved, self.measure)
        };
        self.lines.write(&line)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.flush()
    }
}

/// Numbers of an answer, in their order. Which of them are columns depends on the [`Measure`].
pub const NUMBERS: [&str; 20] = [
    "x_mm",
    "y_mm",
    "force_n",
    "sd_x_mm",
    "sd_y_mm",
    "sd_force_n",
    "half68_mm",
    "half95_mm",
    "half68_n",
    "half95_n",
    "other_x_mm",
    "other_y_mm",
    "misfit",
    "relative_force",
    "half68_relative_force",
    "half95_relative_force",
    "depth_mm",
    "sd_depth_mm",
    "half68_depth_mm",
    "half95_depth_mm",
];

/// Returns the numbers of an answer as they are printed, in the order of [`NUMBERS`]; NaN if a number is unknown or isn't
/// one of the measure's.
pub fn numbers(solution: &Solution, measure: Measure) -> [f64; NUMBERS.len()] {
    let Solution { place, force_n, covariance, half_widths, other, misfit, depth, .. } = solution;
    let sd = |of: fn(&Covariance) -> f64| covariance.as_ref().map_or(f64::NAN, of);
    let half = |of: fn(&HalfWidths) -> f64| half_widths.as_ref().map_or(f64::NAN, of);
    let other = |of: fn(&Place) -> f64| other.as_ref().map_or(f64::NAN, of);
    let in_newtons = |number: f64| if measure == Measure::Force { number } else { f64::NAN };
    let relative = |number: f64| if measure == Measure::RelativeForce { number } else { f64::NAN };
    let depth = depth.filter(|_| measure == Measure::Depth);
    let [half68_mm, half95_mm] = depth.and_then(|depth| depth.half_widths_mm).unwrap_or([f64::NAN; 2]);
    // the relative force of a method may be the length of the reading itself, which has no error of its own
    let relative_half = |half: f64| relative(if round(half, DECIMALS) > 0.0 { half } else { f64::NAN });
    let (half68_n, half95_n) = (half(|half| half.half68_n), half(|half| half.half95_n));
    let numbers = [
        place.x_mm,
        place.y_mm,
        in_newtons(*force_n),
        sd(Covariance::x_mm),
        sd(Covariance::y_mm),
        in_newtons(sd(Covariance::force_n)),
        half(|half| half.half68_mm),
        half(|half| half.half95_mm),
        in_newtons(half68_n),
        in_newtons(half95_n),
        other(|place| place.x_mm),
        other(|place| place.y_mm),
        misfit.unwrap_or(f64::NAN),
        relative(*force_n),
        relative_half(half68_n),
        relative_half(half95_n),
        depth.map_or(f64::NAN, |depth| depth.depth_mm),
        depth.and_then(|depth| depth.sd_mm).unwrap_or(f64::NAN),
        half68_mm,
        half95_mm,
    ];
    numbers.map(|number| round(number, DECIMALS)).map(|number| if number.is_finite() { number } else { f64::NAN })
}

impl SolutionLine<'_> {
    /// Returns the answer without what only the line knows.
    fn of(solved: &Result<Solution, impl Error>, measure: Measure) -> Self {
        let found = solved.as_ref().ok();
        let unknown = [f64::NAN; NUMBERS.len()];
        let numbers = found.map_or(unknown, |solution| numbers(solution, measure));
        let known = numbers.map(|number| Some(number).filter(|number| number.is_finite()));
        let [x_mm, y_mm, force_n, sd_x_mm, sd_y_mm, sd_force_n, rest @ ..] = known;
        let [half68_mm, half95_mm, half68_n, half95_n, other_x_mm, other_y_mm, misfit, relative @ ..] = rest;
        let [relative, half68_relative, half95_relative, depth @ ..] = relative;
        let column = |name: &str, number: Option<f64>| measure.has(name).then_some(number);
        SolutionLine {
            line: None,
            id: None,
            t_s: None,
            x_mm,
            y_mm,
            force_n: column("force_n", force_n),
            depth_mm: column("depth_mm", depth[0]),
            sd_x_mm,
            sd_y_mm,
            sd_force_n: column("sd_force_n", sd_force_n),
            sd_depth_mm: column("sd_depth_mm", depth[1]),
            half68_mm,
            half95_mm,
            half68_n: column("half68_n", half68_n),
            half95_n: column("half95_n", half95_n),
            half68_depth_mm: column("half68_depth_mm", depth[2]),
            half95_depth_mm: column("half95_depth_mm", depth[3]),
            other_x_mm,
            other_y_mm,
            misfit,
            relative_force: column("relative_force", relative),
            half68_relative_force: column("half68_relative_force", half68_relative),
            half95_relative_force: column("half95_relative_force", half95_relative),
            load: None,
            verdict: found.map_or(UNSOLVED, |s| s.verdict.word()),
            unit: found.and_then(|s| match s.verdict {
                ContactVerdict::ChannelFault(unit) => Some(unit + 1),
                _ => None,
            }),
            left_out: String::new(),
            error: None,
        }
    }
}

/// Returns the stream's own error.
pub(super) fn io_error(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_solver::{SolveError, SolvedDepth};

    const AT_FAULT: &[FaultyUnit] = &[FaultyUnit { unit: 7, odds: 25_000.0 }];
    const NO_WIDTHS: &str =
        r#""half68_mm":null,"half95_mm":null,"half68_n":null,"half95_n":null,"other_x_mm":null,"other_y_mm":null,"#;

    fn written(json: bool, keep_going: bool, lines: &[(Reading, Result<Solution, SolveError>)]) -> String {
        written_with(json, keep_going, Measure::Force, lines)
    }

    fn written_with(
        json: bool,
        keep_going: bool,
        measure: Measure,
        lines: &[(Reading, Result<Solution, SolveError>)],
    ) -> String {
        let mut bytes = Vec::new();
        let mut solutions = Solutions::new(&mut bytes, json, keep_going, measure);
        lines.iter().for_each(|(reading, solved)| solutions.write(reading, AT_FAULT, solved).unwrap());
        solutions.flush().unwrap();
        drop(solutions);
        String::from_utf8(bytes).unwrap()
    }

    fn lines() -> [(Reading, Result<Solution, SolveError>); 3] {
        let reading = Reading { id: Some(Value::from("a,b")), t_s: Some(Value::from(0.5)), ..Reading::default() };
        let covariance = Covariance([[0.04, 0.0, 0.0], [0.0, 0.09, 0.0], [0.0, 0.0, -1.0]]);
        let sure = Solution {
            place: Place::new(1.25, -2.0000001),
            force_n: 1.0,
            depth: Some(SolvedDepth { depth_mm: 0.5, sd_mm: Some(0.01), half_widths_mm: Some([0.02, 0.03]) }),
            covariance: Some(covariance),
            half_widths: Some(HalfWidths { half68_mm: 0.4, half95_mm: 0.8, half68_n: 0.1, half95_n: 0.25 }),
            other: Some(Place::new(3.0, 4.0)),
            misfit: Some(0.5),
            verdict: ContactVerdict::ChannelFault(4),
            is_calibrated_load: false,
        };
        let unsure = Solution {
            covariance: None,
            half_widths: None,
            other: None,
            misfit: None,
            verdict: ContactVerdict::NotOneContact,
            ..sure
        };
        [(reading, Ok(sure)), (Reading::default(), Ok(unsure)), (Reading::default(), Err(SolveError::AllEqual))]
    }

    #[test]
    fn a_contact_is_a_line_with_what_is_unknown_left_empty() {
        let expected = "\
id,t_s,x_mm,y_mm,force_n,sd_x_mm,sd_y_mm,sd_force_n,half68_mm,half95_mm,half68_n,half95_n,other_x_mm,other_y_mm,misfit,verdict,unit,left_out
\"a,b\",0.5,1.25,-2.0,1.0,0.2,0.3,,0.4,0.8,0.1,0.25,3.0,4.0,0.5,channel-fault,5,8:25000
,,1.25,-2.0,1.0,,,,,,,,,,,not-one-contact,,8:25000
,,,,,,,,,,,,,,,unsolved,,8:25000
";
        assert_eq!(written(false, false, &lines()), expected);
        let without = written(false, false, &lines()[1..]);
        assert!(without.starts_with("x_mm,") && without.ends_with("\n,,,,,,,,,,,,,unsolved,,8:25000\n"), "{without}");
        assert_eq!(written(false, false, &[]), "");
    }

    #[test]
    fn a_contact_is_an_object_with_null_for_what_is_unknown() {
        let expected = r#"{"id":"a,b","t_s":0.5,"x_mm":1.25,"y_mm":-2.0,"force_n":1.0,"#.to_owned()
            + r#""sd_x_mm":0.2,"sd_y_mm":0.3,"sd_force_n":null,"half68_mm":0.4,"half95_mm":0.8,"half68_n":0.1,"#
            + r#""half95_n":0.25,"other_x_mm":3.0,"other_y_mm":4.0,"misfit":0.5,"verdict":"channel-fault","unit":5,"left_out":"8:25000"}"#
            + "\n"
            + r#"{"x_mm":1.25,"y_mm":-2.0,"force_n":1.0,"sd_x_mm":null,"sd_y_mm":null,"sd_force_n":null,"#
            + NO_WIDTHS
            + r#""misfit":null,"verdict":"not-one-contact","unit":null,"left_out":"8:25000"}"#
            + "\n"
            + r#"{"x_mm":null,"y_mm":null,"force_n":null,"sd_x_mm":null,"sd_y_mm":null,"sd_force_n":null,"#
            + NO_WIDTHS
            + r#""misfit":null,"#
            + r#""verdict":"unsolved","unit":null,"left_out":"8:25000","error":"all outputs are equal: the reading correlates with no place"}"#
            + "\n";
        assert_eq!(written(true, false, &lines()), expected);
    }

    #[test]
    fn forces_that_are_not_known_are_blank_and_relative_ones_have_columns_of_their_own() {
        let mut lines = lines();
        if let Ok(Solution { half_widths: Some(half), .. }) = &mut lines[0].1 {
            half.half95_n = 4e-7;
        }
        let expected = "\
id,t_s,x_mm,y_mm,force_n,sd_x_mm,sd_y_mm,sd_force_n,half68_mm,half95_mm,half68_n,half95_n,other_x_mm,other_y_mm,misfit,relative_force,half68_relative_force,half95_relative_force,verdict,unit,left_out
\"a,b\",0.5,1.25,-2.0,,0.2,0.3,,0.4,0.8,,,3.0,4.0,0.5,1.0,0.1,,channel-fault,5,8:25000
,,1.25,-2.0,,,,,,,,,,,,1.0,,,not-one-contact,,8:25000
,,,,,,,,,,,,,,,,,,unsolved,,8:25000
";
        assert_eq!(written_with(false, false, Measure::RelativeForce, &lines), expected);
        let objects = written_with(true, false, Measure::RelativeForce, &lines);
        assert!(objects.starts_with(r#"{"id":"a,b","t_s":0.5,"x_mm":1.25,"y_mm":-2.0,"force_n":null,"#), "{objects}");
        let relative = r#""relative_force":1.0,"half68_relative_force":0.1,"half95_relative_force":null,"#;
        assert!(objects.contains(relative) && objects.matches("relative_force\":null").count() == 6, "{objects}");
    }

    #[test]
    fn depths_take_the_columns_of_forces() {
        let expected = "\
id,t_s,x_mm,y_mm,depth_mm,sd_x_mm,sd_y_mm,sd_depth_mm,half68_mm,half95_mm,half68_depth_mm,half95_depth_mm,other_x_mm,other_y_mm,misfit,verdict,unit,left_out
\"a,b\",0.5,1.25,-2.0,0.5,0.2,0.3,0.01,0.4,0.8,0.02,0.03,3.0,4.0,0.5,channel-fault,5,8:25000
";
        assert_eq!(written_with(false, false, Measure::Depth, &lines()[..1]), expected);
        let objects = written_with(true, false, Measure::Depth, &lines());
        assert!(objects.contains("\"depth_mm\":0.5,") && !objects.contains("force"), "{objects}");
    }

    #[test]
    fn where_bad_lines_are_answered_every_answer_has_its_line_and_all_columns() {
        let [_, unsure, unsolved] = lines();
        let lines = [unsolved, unsure].map(|(reading, solved)| (Reading { line: 7, ..reading }, solved));
        let expected = "\
line,id,t_s,x_mm,y_mm,force_n,sd_x_mm,sd_y_mm,sd_force_n,half68_mm,half95_mm,half68_n,half95_n,other_x_mm,other_y_mm,misfit,verdict,unit,left_out,error
7,,,,,,,,,,,,,,,,unsolved,,8:25000,all outputs are equal: the reading correlates with no place
7,,,1.25,-2.0,1.0,,,,,,,,,,,not-one-contact,,8:25000,
";
        assert_eq!(written(false, true, &lines), expected);
        let objects = written(true, true, &lines);
        assert!(objects.lines().all(|line| line.starts_with("{\"line\":7,\"x_mm\":")), "{objects}");
        assert_eq!(objects.matches("\"error\"").count(), 1, "{objects}");
    }
}
