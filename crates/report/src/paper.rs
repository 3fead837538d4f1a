//! Results reported in the paper (Sensors 2018, 18, 351), shown next to this program's results.
//!
//! The numbers are in `data/paper.toml`, which is read when the program is compiled. A missing key, or a wrong count of numbers
//! after a key, is a compiler error.

/// Text with one key per line, each with a number or a list of numbers.
const TEXT: &str = include_str!("../../../data/paper.toml");

/// Number of test points.
pub const POINTS: usize = number("test_points") as usize;
/// Mean location error, mm.
pub const LOCATION_ERROR_MM: f64 = number("location_error_mm");
/// Mean force error, N.
pub const FORCE_ERROR_N: f64 = number("force_error_n");
/// Fraction of the points with a location error under 1 mm.
pub const WITHIN_1MM: f64 = number("within_1mm_percent") / 100.0;
/// Fraction of the points with a force error under 0.1 N.
pub const WITHIN_0_1N: f64 = number("within_0_1n_percent") / 100.0;
/// Fraction of the points with both.
pub const WITHIN_BOTH: f64 = number("within_both_percent") / 100.0;

/// Table 1, one row for each unit: repeatability when loading and when unloading, hysteresis, %. The paper doesn't define these
/// quantities.
pub const TABLE_1_PERCENT: [[f64; 3]; 9] = [
    numbers("unit_1"),
    numbers("unit_2"),
    numbers("unit_3"),
    numbers("unit_4"),
    numbers("unit_5"),
    numbers("unit_6"),
    numbers("unit_7"),
    numbers("unit_8"),
    numbers("unit_9"),
];

/// Loading repeatability of each unit, %. One standard deviation of the scenes' noise is a third of this value.
pub fn repeatability_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[loading, _, _]| loading)
}

/// Hysteresis of each unit, %.
pub fn hysteresis_percent() -> [f64; 9] {
    TABLE_1_PERCENT.map(|[_, _, hysteresis]| hysteresis)
}

const fn number(key: &str) -> f64 {
    let [number] = numbers(key);
    number
}

/// Returns the numbers of a key. They aren't negative and have no exponent.
const fn numbers<const COUNT: usize>(key: &str) -> [f64; COUNT] {
    let text = TEXT.as_bytes();
    let mut at = value_of(key.as_bytes());
    let mut found = [0.0; COUNT];
    let mut count = 0;
    while at < text.len() && text[at] != b'\n' && text[at] != b'#' {
        if text[at].is_ascii_digit() {
            assert!(count < COUNT, "data/paper.toml: a key has too many numbers");
            (found[count], at) = number_at(at);
            count += 1;
        } else {
            assert!(matches!(text[at], b' ' | b',' | b'[' | b']'), "data/paper.toml: a value isn't a number");
            at += 1;
        }
    }
    assert!(count == COUNT, "data/paper.toml: a key has too few numbers");
    found
}

/// Returns the position where the value of a key begins.
const fn value_of(key: &[u8]) -> usize {
    let text = TEXT.as_bytes();
    let mut line = 0;
    while line < text.len() {
        let mut matching = 0;
        while matching < key.len() && line + matching < text.len() && text[line + matching] == key[matching] {
            matching += 1;
        }
        let behind = line + matching;
        if matching == key.len() && behind + 3 < text.len() && text[behind] == b' ' && text[behind + 1] == b'=' {
            return behind + 2;
        }
        while line < text.len() && text[line] != b'\n' {
            line += 1;
        }
        line += 1;
    }
    panic!("data/paper.toml: a key is missing")
}

/// Returns the number that begins at a digit, and its end. The integer and the power of ten are exact, so their quotient is the
/// same number that the compiler gives for these digits.
const fn number_at(mut at: usize) -> (f64, usize) {
    let text = TEXT.as_bytes();
    let (mut digits, mut scale, mut is_fraction) = (0u64, 1u64, false);
    while at < text.len() && (text[at].is_ascii_digit() || (text[at] == b'.' && !is_fraction)) {
        if text[at] == b'.' {
            is_fraction = true;
        } else {
            digits = 10 * digits + (text[at] - b'0') as u64;
            scale *= if is_fraction { 10 } else { 1 };
            assert!(digits < 1 << 53 && scale < 1 << 53, "data/paper.toml: a number has too many digits");
        }
        at += 1;
    }
    (digits as f64 / scale as f64, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_the_one_that_a_reader_of_toml_finds() {
        let table: toml::Table = TEXT.parse().unwrap();
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
