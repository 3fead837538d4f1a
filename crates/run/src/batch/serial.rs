//! Serial numbers of sensors, which are also names of folders.

/// Largest number of characters of a serial number.
pub(crate) const SERIAL_MOST: usize = 64;

/// Words that a person types instead of a serial number.
const WORDS: [&str; 1] = ["later"];

/// Checks a serial number: 1 to 64 ASCII letters, digits, `-`, `_` and `.`, and the first isn't `.`, which begins a command.
///
/// # Errors
/// What is wrong with it.
pub fn check_serial(serial: &str) -> Result<(), String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if serial.is_empty() || serial.len() > SERIAL_MOST || serial.starts_with('.') || !serial.chars().all(allowed) {
        return Err(format!(
            "not a serial number: expected 1 to {SERIAL_MOST} letters, digits, '-', '_' and '.', and no '.' at the beginning"
        ));
    }
    if WORDS.contains(&serial.to_ascii_lowercase().as_str()) {
        return Err("this word is an answer to a question, so it can't be a serial number".to_owned());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_serial_number_is_also_the_name_of_a_folder() {
        for sound in ["A-017", "1", "2026.11_a", &"x".repeat(SERIAL_MOST)] {
            assert_eq!(check_serial(sound), Ok(()), "{sound}");
        }
        for wrong in ["", ".end", "a b", "a/b", "..", "ä", "later", "LATER", "a\n", &"x".repeat(SERIAL_MOST + 1)] {
            assert!(check_serial(wrong).is_err(), "{wrong:?}");
        }
    }
}
