//! What the paper reports (Sensors 2018, 18, 351): the numbers that ours stand beside.

/// Test points.
pub const POINTS: usize = 100;
/// Mean location error, mm.
pub const LOCATION_ERROR_MM: f64 = 0.46;
/// Mean force error, N.
pub const FORCE_ERROR_N: f64 = 0.043;
/// Share of the points with a location error under 1 mm.
pub const WITHIN_1MM: f64 = 0.93;
/// Share of the points with a force error under 0.1 N.
pub const WITHIN_0_1N: f64 = 0.91;
/// Share of the points with both.
pub const WITHIN_BOTH: f64 = 0.84;

/// Table 1, a row a unit: repeatability when loading and when unloading, hysteresis, %. The paper defines none of them.
pub const TABLE_1_PERCENT: [[f64; 3]; 9] = [
    [1.60, 1.07, 4.11],
    [3.74, 2.78, 2.29],
    [2.19, 2.32, 2.88],
    [0.83, 1.97, 3.08],
    [0.51, 1.44, 3.39],
    [1.02, 1.24, 5.53],
    [0.71, 0.39, 3.99],
    [2.84, 3.23, 4.44],
    [3.97, 4.89, 5.19],
];

/// Loading repeatability of each unit, %: one standard deviation of the scenes' noise is a third of it.
pub fn repeatability_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[loading, _, _]| loading)
}

/// Hysteresis of each unit, %.
pub fn hysteresis_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[_, _, hysteresis]| hysteresis)
}
