//! How a load cell with three axes is mounted: `axes` of `[load_cell]`.

use super::keys::axes;
use super::spec::LoadCellDriver;
use palpate_core::algebra::Matrix;
use palpate_document::{Key, Problem, Table};

/// Longest serial number, characters.
const SERIAL_MAX: usize = 64;

/// Least determinant of a calibration matrix over the product of the lengths of its rows. A smaller one loses a direction.
const LEAST_DETERMINANT: f64 = 1e-6;

/// One axis of the cell, in one of its two directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceAxis {
    /// 0 for its x, 1 for its y, 2 for its z.
    pub index: usize,
    /// Whether its reading has the other sign.
    pub reversed: bool,
}

const fn axis(index: usize, reversed: bool) -> DeviceAxis {
    DeviceAxis { index, reversed }
}

pub(super) const DEVICE_AXES: [(&str, DeviceAxis); 6] = [
    ("x", axis(0, false)),
    ("-x", axis(0, true)),
    ("y", axis(1, false)),
    ("-y", axis(1, true)),
    ("z", axis(2, false)),
    ("-z", axis(2, true)),
];

/// Mounting of a cell with three axes.
#[derive(Clone, Debug, PartialEq)]
pub struct CellAxes {
    /// Axes whose readings grow with a force of the tip along x of the specimen, along y, and with a press.
    pub axes: [DeviceAxis; 3],
    /// Matrix from the cell's calibration, in the cell's own axes; `None` if its readings need none.
    pub matrix: Option<CellMatrix>,
    /// Distance of the tip and largest torque; `None` if not stated.
    pub lever: Option<Lever>,
}

/// What limits the torque at the cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lever {
    /// Distance from the cell's origin to the tip, mm.
    pub mm: f64,
    /// Largest torque about any axis of the cell, N mm.
    pub torque_n_mm: f64,
}

/// Calibration matrix of a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellMatrix {
    /// Its rows.
    pub rows: [[f64; 3]; 3],
    /// Serial number of the cell that it belongs to.
    pub serial: String,
}

impl CellAxes {
    /// Returns the matrix from the forces along the cell's x, y and z to those of the tip on the specimen along x, y and the press.
    pub fn mounting(&self) -> [[f64; 3]; 3] {
        *self.specimen_from_device().rows()
    }

    /// Returns the matrix from the forces of the tip to those along the axes of the cell, as its emulator reads them.
    pub(super) fn to_device(&self) -> [[f64; 3]; 3] {
        let inverse = self.specimen_from_device().inverse(); // a matrix without one is refused
        *inverse.unwrap_or_else(Matrix::identity).rows()
    }

    fn specimen_from_device(&self) -> Matrix<3, 3> {
        let row = |axis: DeviceAxis| {
            let mut row = [0.0; 3];
            row[axis.index] = if axis.reversed { -1.0 } else { 1.0 };
            row
        };
        let matrix = self.matrix.as_ref().map_or_else(Matrix::identity, |matrix| Matrix::of(matrix.rows));
        Matrix::of(self.axes.map(row)) * matrix
    }
}

/// Reads `axes`.
pub(super) fn read_axes(table: &Table) -> Option<CellAxes> {
    let axes = [&axes::x, &axes::y, &axes::press].map(|key| table.word(key, &DEVICE_AXES));
    let matrix = read_matrix(table);
    let lever = [table.number(&axes::tip_mm), table.number(&axes::torque_n_mm)];
    if table.has(&axes::tip_mm) != table.has(&axes::torque_n_mm) {
        table.complain(Problem::new(table.span(), "`tip_mm` and `torque_n_mm` require each other"));
    }
    let lever = if let [Some(mm), Some(torque_n_mm)] = lever { Some(Lever { mm, torque_n_mm }) } else { None };
    let [Some(x), Some(y), Some(press)] = axes else { return None };
    let axes = [x, y, press];
    if (0..3).any(|index| axes.iter().all(|axis| axis.index != index)) {
        let problem = Problem::new(table.span(), "`axes` must name each of the cell's axes x, y and z once");
        table.complain(problem.help("such as axes = { x = \"x\", y = \"-y\", press = \"-z\" }"));
        return None;
    }
    Some(CellAxes { axes, matrix: matrix?, lever })
}

/// Reads `matrix` and `serial`. The outer value is `None` if they are invalid.
fn read_matrix(table: &Table) -> Option<Option<CellMatrix>> {
    let rows = table.matrix(&axes::matrix);
    let Some(serial) = read_serial(table, "`matrix`", &axes::matrix, table.has(&axes::matrix), &axes::serial)? else {
        return Some(None);
    };
    let rows = rows?;
    check_directions(table, "`matrix`", &axes::matrix, &rows.map(Vec::from))?;
    Some(Some(CellMatrix { rows, serial }))
}

/// Reads the serial number of the cell that a matrix belongs to. The inner value is `None` if there is neither, the outer one if
/// they are invalid. `what` the matrix is called in messages.
pub(super) fn read_serial(
    table: &Table,
    what: &str,
    matrix: &Key,
    has_matrix: bool,
    key: &Key,
) -> Option<Option<String>> {
    let serial = table.text(key);
    match (has_matrix, table.has(key)) {
        (false, false) => return Some(None),
        (false, true) => {
            table.complain(Problem::new(table.span_of(key), format!("`serial` requires {what}")));
            return None;
        }
        (true, false) => {
            let problem = Problem::new(table.span_of(matrix), format!("{what} requires `serial`"));
            table.complain(problem.help("state the serial number of the cell: a matrix is wrong for any other cell"));
            return None;
        }
        (true, true) => {}
    }
    let serial = serial?;
    if !(1..=SERIAL_MAX).contains(&serial.chars().count()) || serial.contains(char::is_control) {
        let text = format!("`serial` is {serial:?}, expected 1 to {SERIAL_MAX} printable characters");
        table.complain(Problem::new(table.span_of(key), text));
        return None;
    }
    Some(Some(serial.to_owned()))
}

/// Checks that a matrix keeps the three directions of the force.
pub(super) fn check_directions(table: &Table, what: &str, matrix: &Key, rows: &[Vec<f64>; 3]) -> Option<()> {
    let products = products(rows);
    let lengths: f64 = products.diagonal().values().iter().product();
    // of a square matrix, this is the square of the determinant
    let determinant = products.determinant();
    if determinant.is_finite() && determinant > LEAST_DETERMINANT.powi(2) * lengths {
        return Some(());
    }
    let problem = Problem::new(table.span_of(matrix), format!("{what} is singular: it loses a direction of the force"));
    table.complain(problem.help("copy its three rows from the cell's calibration"));
    None
}

/// Returns the products of the rows of a matrix with each other.
pub(super) fn products(rows: &[Vec<f64>; 3]) -> Matrix<3, 3> {
    let product = |a: &Vec<f64>, b: &Vec<f64>| a.iter().zip(b).map(|(a, b)| a * b).sum();
    Matrix::of([0, 1, 2].map(|i| [0, 1, 2].map(|j| product(&rows[i], &rows[j]))))
}

/// Checks that the axes are stated for a cell with three axes, and only for such a cell.
pub(super) fn check_axes(
    driver: &dyn LoadCellDriver,
    axes: Option<&CellAxes>,
    table: &Table,
    span: std::ops::Range<usize>,
) {
    let (text, help) = match (driver.has_axes(), axes) {
        (true, None) => (
            "`axes` is missing: the cell has three axes, and which way it is mounted isn't guessed",
            "add axes = { x = \"x\", y = \"y\", press = \"-z\" } to [load_cell]: the axes of the cell whose readings grow with a force \
             of the tip along x and y of the specimen, and with a press",
        ),
        (false, Some(_)) => ("`axes` is for a cell with three axes, but this one has one", "remove `axes`"),
        _ => return,
    };
    table.complain(Problem::new(span, text).help(help));
}

#[cfg(test)]
mod tests {
    use crate::rig::{RigSpec, SIM_RIG, parse};

    /// The shipped rig with a Net F/T, and these keys in `[load_cell]`.
    fn read(driver: &str, axes: &str) -> Result<RigSpec, Vec<String>> {
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        let text = SIM_RIG.replacen("{ modbus = \"generic-rs485\" }", &format!("{driver}\n{axes}"), 1);
        assert_ne!(text, SIM_RIG);
        let wrong = |problem: &String| problem.split_once(": ").unwrap().1.to_owned();
        parse("rig.toml", &text, &none).map_err(|problems| problems.lines().iter().map(wrong).collect())
    }

    const NET_FT: &str = "{ lines = \"ati-netft\" }";

    #[test]
    fn mounting_permutes_after_the_matrix_and_the_emulator_inverts_both() {
        let axes = |more: &str| read(NET_FT, &format!("axes = {{ x = \"y\", y = \"-x\", press = \"-z\"{more} }}"));
        let plain = axes("").unwrap().load_cell.axes.unwrap();
        assert_eq!(plain.mounting(), [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
        assert_eq!(plain.to_device(), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
        let matrix = ", serial = \"FT1\", matrix = [[2.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 4.0]]";
        let corrected = axes(matrix).unwrap().load_cell.axes.unwrap();
        assert_eq!(corrected.mounting(), [[0.5, 1.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, -4.0]]);
        assert_eq!(corrected.to_device(), [[0.0, -0.5, 0.0], [1.0, 0.25, 0.0], [0.0, 0.0, -0.25]]);
    }

    #[test]
    fn wrong_mountings_are_refused() {
        let straight = "x = \"x\", y = \"y\", press = \"-z\"";
        for (driver, axes, text) in [
            (
                NET_FT,
                String::new(),
                "`axes` is missing: the cell has three axes, and which way it is mounted isn't guessed",
            ),
            (
                "{ lines = \"mark-10\" }",
                format!("axes = {{ {straight} }}"),
                "`axes` is for a cell with three axes, but this one has one",
            ),
            (
                NET_FT,
                "axes = { x = \"x\", y = \"-x\", press = \"z\" }".to_owned(),
                "`axes` must name each of the cell's axes x, y and z once",
            ),
            (
                NET_FT,
                "axes = { x = \"x\", y = \"y\", press = \"down\" }".to_owned(),
                "`press` is \"down\", expected one of x, -x, y, -y, z, -z",
            ),
            (NET_FT, format!("axes = {{ {straight}, serial = \"FT1\" }}"), "`serial` requires `matrix`"),
            (NET_FT, format!("axes = {{ {straight}, tip_mm = 30 }}"), "`tip_mm` and `torque_n_mm` require each other"),
            (
                NET_FT,
                format!("axes = {{ {straight}, tip_mm = 80, torque_n_mm = 120 }}"),
                "`force_n` is 2 N at a tip 80 mm from the cell's origin: up to 160 N mm, but the cell allows 120 N mm",
            ),
            (
                NET_FT,
                format!("axes = {{ {straight}, matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] }}"),
                "`matrix` requires `serial`",
            ),
            (
                NET_FT,
                format!("axes = {{ {straight}, serial = \"FT1\", matrix = [[1, 2, 3], [2, 4, 6], [0, 0, 1]] }}"),
                "`matrix` is singular: it loses a direction of the force",
            ),
            (
                NET_FT,
                format!("axes = {{ {straight}, serial = \"FT1\", matrix = [[1, 0], [0, 1], [0, 0]] }}"),
                "`matrix` must have three lists of three numbers",
            ),
            (
                NET_FT,
                format!("axes = {{ {straight}, serial = \"FT1\", matrix = [[nan, 0, 0], [0, 1, 0], [0, 0, 1]] }}"),
                "`matrix` is not a finite number",
            ),
            (
                NET_FT,
                format!("axes = {{ {straight}, serial = \"\", matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] }}"),
                "`serial` is \"\", expected 1 to 64 printable characters",
            ),
        ] {
            assert_eq!(read(driver, &axes).map(|_| ()).unwrap_err(), [text], "{axes}");
        }
    }

    #[test]
    fn packets_need_a_link_that_has_them() {
        let text = include_str!("../../../../rigs/esp301.toml");
        let none = |_: &str| Err(std::io::Error::from(std::io::ErrorKind::NotFound));
        let axes = "{ lines = \"ati-netft\" }\naxes = { x = \"x\", y = \"y\", press = \"-z\" }";
        let text = text.replacen("{ modbus = \"generic-rs485\" }", axes, 1);
        let words = parse("rig.toml", &text, &none).unwrap_err().lines();
        let expected = "the line profile \"ati-netft\" is for packets, but serial:///dev/ttyUSB1?baud=115200 has none";
        assert!(words.len() == 1 && words[0].ends_with(expected), "{words:?}");
        let text = text.replacen("serial:///dev/ttyUSB1?baud=115200", "udp://192.168.1.1:49152", 1);
        assert_eq!(parse("rig.toml", &text, &none).unwrap().load_cell.link.to_string(), "udp://192.168.1.1:49152");
    }
}
