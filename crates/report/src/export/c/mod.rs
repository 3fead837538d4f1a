//! A calibrated sensor as one C99 file, for the controller of a hand: tables and one function, single precision, no heap.

use palpate_solver::tables::{MapTables, MethodTables, Points, Splines, Tables};
use palpate_solver::{Fitted, ForceRule, Model, Solver as _, Validity};
use std::fmt::Write as _;

/// Parts of the file that don't depend on the sensor.
const BEGIN: &str = include_str!("begin.c");
const EXACT: &str = include_str!("exact.c");
const USED: &str = include_str!("used.c");
const POINTS: &str = include_str!("points.c");
const FORCE_CLOSEST: &str = include_str!("force_closest.c");
const FORCE_SQUARES: &str = include_str!("force_squares.c");
const MAP: &str = include_str!("map.c");

/// Number of values in a line of a table.
const VALUES_A_LINE: usize = 8;

/// Reason why a method has no C file.
#[derive(Debug, PartialEq, thiserror::Error, miette::Diagnostic)]
#[error("{method} can't be exported as C: only pearson, pearson-lsq, surrogate and physics can")]
#[diagnostic(help("fit it with one of them: `palpate fit RUN --solver surrogate --out sensor.palpate`"))]
pub struct NoC {
    /// Description of the method.
    pub method: String,
}

fn described(fitted: &Fitted) -> String {
    match fitted.at_calibrated_load() {
        Some(second) => format!("`{}` with `{second}` for readings with the load of the calibration", fitted.name()),
        None if fitted.depth_curve().is_some() => format!("`{}` for depths", fitted.name()),
        None => format!("`{}`", fitted.name()),
    }
}

/// Returns the C file of a model. `title` describes the sensor in its first comment.
///
/// Tables are scaled so that the largest calibrated output is 1: then single precision suffices for outputs of any unit.
///
/// # Errors
/// The method isn't one of those that can be written as C.
pub fn c_file(model: &Model, title: &str) -> Result<String, NoC> {
    let tables = model.tables().ok_or_else(|| NoC { method: described(model.fitted()) })?;
    let mut file = File { text: String::new() };
    file.begin(&tables, &format!("{title}, {}", range_of(model.validity())));
    match &tables.kind {
        MethodTables::Points(points) => file.points(&tables, points),
        MethodTables::Map(map) => file.map(&tables, map),
    }
    file.text += "#endif\n";
    Ok(file.text)
}

/// Describes the calibration.
fn range_of(validity: &Validity) -> String {
    let Validity { presses, x_mm: [x, to_x], y_mm: [y, to_y], force_n, .. } = validity;
    let forces = force_n.map(|[least, most]| format!(", {least} to {most} N")).unwrap_or_default();
    format!("{presses} presses at x {x} to {to_x} mm, y {y} to {to_y} mm{forces}")
}

/// A C file that is being written.
struct File {
    text: String,
}

impl File {
    /// Writes declarations that another file may include.
    fn begin(&mut self, tables: &Tables, title: &str) {
        let Tables { method, outputs, .. } = tables;
        // nothing in a title ends the comment
        let title = title.replace("*/", "* /").replace(['\n', '\r'], " ");
        let version = env!("CARGO_PKG_VERSION");
        let _ = write!(
            self.text,
            "/* {title}: {method}, written by palpate {version}.\n\n   C99, single precision, no heap, needs the math library. \
             Compile this file once. Where it is used:\n\n       #define PALPATE_DECLARATIONS\n       #include \"this file\"\n\n   \
             and call palpate_solve with the outputs of a reading, without the outputs without load. */\n\
             #ifndef PALPATE_SENSOR\n#define PALPATE_SENSOR\n\n#define PALPATE_OUTPUTS {outputs} /* outputs of a reading */\n\n{BEGIN}\
             #endif\n\n#if !defined(PALPATE_DECLARATIONS) && !defined(PALPATE_DEFINITIONS)\n#define PALPATE_DEFINITIONS\n\n\
             {EXACT}#include <math.h>\n\n"
        );
    }

    fn points(&mut self, tables: &Tables, points: &Points) {
        let Points { places, forces_n, closest, rows, directions, force_rule, most_residue } = points;
        let scale = scale(rows);
        self.common(tables, scale);
        let count = places.len();
        self.define("POINTS", count);
        self.number("LEAST_LENGTH", LEAST_LENGTH);
        self.table("PLACES", &[count, 2], places.iter().flat_map(|place| [place.x_mm, place.y_mm]));
        self.table("FORCES_N", &[count], forces_n.iter().copied());
        self.table("ROWS", &[count, tables.kept.len()], rows.iter().map(|value| scale * value));
        self.table("DIRECTIONS", &[count, tables.kept.len()], directions.iter().copied());
        self.table("MOST_RESIDUE", &[2], most_residue.iter().copied());
        if *force_rule == ForceRule::ClosestUnit {
            self.integers("CLOSEST", closest);
        }
        self.text += USED;
        self.text += match force_rule {
            ForceRule::ClosestUnit => FORCE_CLOSEST,
            ForceRule::LeastSquares => FORCE_SQUARES,
        };
        self.text += POINTS;
    }

    fn map(&mut self, tables: &Tables, map: &MapTables) {
        let (scale, used) = (scale(&map.response.coefficients) / map.force_n, tables.kept.len());
        self.common(tables, scale);
        let [least, most] = map.response.area;
        self.number("FORCE_N", map.force_n);
        self.define("CONSTANT_LOAD", usize::from(map.is_constant_load));
        self.define("COMMON_OFFSET", usize::from(map.common_offset));
        self.define("STARTS", map.starts.len());
        self.define("STARTS_A_SIDE", map.starts_a_side);
        self.define("MOST_STARTS", map.search.most_starts);
        self.define("MOST_STEPS", map.search.most_steps);
        self.define("MOST_HALVINGS", map.search.most_halvings);
        self.number("LONGEST_STEP", map.search.longest_step);
        self.number("LAST_GAIN", map.search.last_gain);
        self.number("BROKEN_SD", map.search.broken_sd);
        self.number("LEAST_PIVOT", LEAST_PIVOT);
        self.number("MOST_CHI2", map.most[0]);
        self.number("MOST_CHI2_WITHOUT_ONE", map.most[1]);
        self.number("INSIDE", map.inside);
        self.number("KNOWN", map.known);
        self.table("LEAST_MM", &[2], [least.x_mm, least.y_mm].into_iter());
        self.table("MOST_MM", &[2], [most.x_mm, most.y_mm].into_iter());
        self.splines("RESPONSE", &map.response, used, scale);
        self.splines("LEVERAGE", &map.leverage, used, 1.0);
        let [additive, proportional] = &map.noise;
        let additive = additive.iter().map(|variance| scale * scale * variance);
        self.table("NOISE", &[2, used], additive.chain(proportional.iter().copied()));
        self.table("SD", &[used], map.sd.iter().map(|sd| scale * sd));
        self.table("LOUDEST", &[used], map.loudest.iter().map(|loudest| scale * loudest));
        self.table("START_PLACES", &[map.starts.len(), 2], map.starts.iter().flat_map(|p| [p.x_mm, p.y_mm]));
        self.table("DIRECTIONS", &[map.starts.len(), used], map.directions.iter().copied());
        self.text += USED;
        self.text += MAP;
    }

    /// Writes what all methods need.
    fn common(&mut self, tables: &Tables, scale: f64) {
        let Tables { kept, silence, no_contact, .. } = tables;
        self.define("USED", kept.len());
        self.define("FORCES_ARE_KNOWN", usize::from(tables.forces_are_known));
        self.number("SCALE", scale);
        self.integers("KEPT", kept);
        let silence = silence.iter().map(|variance| scale * scale * variance);
        // without known noise no reading is weak
        let unknown = std::iter::repeat_n(1.0, if tables.silence.is_empty() { kept.len() } else { 0 });
        self.table("SILENCE", &[kept.len()], silence.chain(unknown));
        self.number("NO_CONTACT", if tables.silence.is_empty() { 0.0 } else { *no_contact });
    }

    fn splines(&mut self, name: &str, splines: &Splines, used: usize, scale: f64) {
        let Splines { area: [least, _], step_mm, cells, coefficients } = splines;
        let pair = |values: [f64; 2]| format!("{{{}, {}}}", literal(values[0]), literal(values[1]));
        let (least, step) = (pair([least.x_mm, least.y_mm]), pair(*step_mm));
        let _ = writeln!(self.text, "#define {name}_LEAST {least}\n#define {name}_STEP {step}");
        let _ = writeln!(self.text, "#define {name}_CELLS {{{}, {}}}", cells[0], cells[1]);
        let nodes = coefficients.len() / used.max(1);
        self.table(&format!("{name}_NODES"), &[nodes, used], coefficients.iter().map(|value| scale * value));
    }

    fn define(&mut self, name: &str, value: usize) {
        let _ = writeln!(self.text, "#define {name} {value}");
    }

    fn number(&mut self, name: &str, value: f64) {
        let _ = writeln!(self.text, "#define {name} {}", literal(value));
    }

    fn integers(&mut self, name: &str, values: &[usize]) {
        let all: Vec<String> = values.iter().map(usize::to_string).collect();
        self.array("short", name, &[values.len()], &all);
    }

    /// Writes a table of one or two dimensions.
    fn table(&mut self, name: &str, sizes: &[usize], values: impl Iterator<Item = f64>) {
        self.array("float", name, sizes, &values.map(literal).collect::<Vec<String>>());
    }

    fn array(&mut self, kind: &str, name: &str, sizes: &[usize], values: &[String]) {
        let sizes_text: String = sizes.iter().map(|size| format!("[{size}]")).collect();
        let _ = write!(self.text, "static const {kind} {name}{sizes_text} = {{");
        let row = if sizes.len() == 2 { sizes[1] } else { VALUES_A_LINE };
        for values in values.chunks(row.max(1)) {
            let line = values.join(", ");
            let _ = if sizes.len() == 2 {
                write!(self.text, "\n    {{{line}}},")
            } else {
                write!(self.text, "\n    {line},")
            };
        }
        self.text += "\n};\n";
    }
}

/// Least length of a reading minus its mean, relative to its largest output. Below it there is only rounding in single precision.
const LEAST_LENGTH: f64 = 1e-6;

/// Fraction of a pivot that must remain, in single precision.
const LEAST_PIVOT: f64 = 1e-6;

/// Factor that brings the largest value to 1.
fn scale(values: &[f64]) -> f64 {
    let largest = values.iter().map(|value| value.abs()).fold(0.0, f64::max);
    if largest > 0.0 { 1.0 / largest } else { 1.0 }
}

/// Returns a number in single precision as C writes it.
fn literal(value: f64) -> String {
    let single = value as f32;
    match single {
        _ if single.is_nan() => "NAN".to_owned(),
        _ if single.is_infinite() => if single > 0.0 { "INFINITY" } else { "-INFINITY" }.to_owned(),
        _ => format!("{single:?}f"),
    }
}
