//! Numbers as an Arduino prints them (arduino/ArduinoCore-avr, cores/arduino/Print.cpp).

/// Largest number that is printed as digits. Beyond it an Arduino prints `ovf`.
const MOST: f64 = 4_294_967_040.0;

/// Appends what `Serial.print(number, decimals)` sends: half a step is added and the rest cut off. A small negative number keeps
/// its sign (`-0.00`).
pub(super) fn print_float(number: f64, decimals: u32, line: &mut Vec<u8>) {
    if number.is_nan() || number.abs() > MOST {
        let word: &[u8] = match number {
            _ if number.is_nan() => b"nan",
            _ if number.is_infinite() => b"inf",
            _ => b"ovf",
        };
        line.extend_from_slice(word);
        return;
    }
    if number < 0.0 {
        line.push(b'-');
    }
    let rounded = number.abs() + 0.5 / 10_f64.powi(decimals as i32);
    line.extend_from_slice((rounded as u64).to_string().as_bytes());
    if decimals > 0 {
        line.push(b'.');
    }
    let mut rest = rounded.fract();
    for _ in 0..decimals {
        rest *= 10.0;
        line.push(b'0' + (rest as u8).min(9));
        rest = rest.fract();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn printed(number: f64, decimals: u32) -> String {
        let mut line = Vec::new();
        print_float(number, decimals, &mut line);
        String::from_utf8(line).expect("text")
    }

    #[test]
    fn numbers_are_printed_as_print_cpp_does() {
        assert_eq!(printed(1.999, 2), "2.00"); // its own example
        assert_eq!(printed(-12.3456, 2), "-12.35");
        assert_eq!(printed(-0.001, 2), "-0.00");
        assert_eq!(printed(0.05, 1), "0.1");
        assert_eq!(printed(7.5, 0), "8");
        assert_eq!([f64::NAN, f64::NEG_INFINITY, 5e9].map(|number| printed(number, 2)), ["nan", "inf", "ovf"]);
    }
}
