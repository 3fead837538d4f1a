//! Results reported in the paper (Sensors 2018, 18, 351), shown next to this program's results. `data/paper.toml` has the same
//! numbers for other programs, and the section of each.

/// Number of test points.
pub const POINTS: usize = 100;
/// Mean location error, mm.
pub const LOCATION_ERROR_MM: f64 = 0.46;
/// Mean force error, N.
pub const FORCE_ERROR_N: f64 = 0.043;
/// Fraction of the points with a location error under 1 mm.
pub const WITHIN_1MM: f64 = 0.93;
/// Fraction of the points with a force error under 0.1 N.
pub const WITHIN_0_1N: f64 = 0.91;
/// Fraction of the points with both.
pub const WITHIN_BOTH: f64 = 0.84;

/// Table 1, one row for each unit: repeatability when loading and when unloading, hysteresis, %. The paper doesn't define these
/// quantities.
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

/// Loading repeatability of each unit, %. One standard deviation of the scenes' noise is a third of this value.
pub fn repeatability_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[loading, _, _]| loading)
}

/// Hysteresis of each unit, %.
pub fn hysteresis_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[_, _, hysteresis]| hysteresis)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_data_file() {
        let table: toml::Table = include_str!("../../../data/paper.toml").parse().unwrap();
        let all = |key: &str| match &table[key] {
            toml::Value::Array(values) => values.iter().map(|value| value.as_float().unwrap()).collect(),
            value => vec![value.as_float().unwrap_or_else(|| value.as_integer().unwrap() as f64)],
        };
        for (key, found) in [
            ("test_points", POINTS as f64),
            ("location_error_mm", LOCATION_ERROR_MM),
            ("force_error_n", FORCE_ERROR_N),
            ("within_1mm_percent", 100.0 * WITHIN_1MM),
            ("within_0_1n_percent", 100.0 * WITHIN_0_1N),
            ("within_both_percent", 100.0 * WITHIN_BOTH),
        ] {
            assert_eq!(all(key), [found], "{key}");
        }
        for (unit, row) in TABLE_1_PERCENT.iter().enumerate() {
            assert_eq!(all(&format!("unit_{}", unit + 1)), row);
        }
        assert_eq!(table["units"].as_integer(), Some(TABLE_1_PERCENT.len() as i64));
    }
}
