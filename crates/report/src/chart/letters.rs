//! Estimates widths of texts without a font file. The widths are those of DejaVu Sans, the widest of the fonts that a figure
//! names.

/// Replacement for the middle of a text that is too long.
const GAP: char = '…';

/// Width of a text with letters of this size, px.
pub(super) fn width_px(text: &str, size_px: f64) -> f64 {
    size_px * text.chars().map(width_em).sum::<f64>()
}

/// Splits a text into lines no wider than `most_px`. A wider word has its own line.
pub(super) fn wrapped(text: &str, size_px: f64, most_px: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if width_px(line, size_px) + width_px(word, size_px) + width_px(" ", size_px) <= most_px => {
                *line = format!("{line} {word}");
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Returns a text no wider than `most_px`. A longer text keeps its beginning and its end.
pub(super) fn shortened(text: &str, size_px: f64, most_px: f64) -> String {
    let letters: Vec<char> = text.chars().collect();
    let without = |count: usize| -> String {
        let first = (letters.len() - count).div_ceil(2);
        let (before, after) = (&letters[..first], &letters[first + count..]);
        before.iter().chain((count > 0).then_some(&GAP)).chain(after).collect()
    };
    let fits = |words: &String| width_px(words, size_px) <= most_px;
    (0..letters.len()).map(without).find(fits).unwrap_or_else(|| GAP.to_string())
}

/// Width of a letter as a fraction of its size.
fn width_em(letter: char) -> f64 {
    match letter {
        'i' | 'j' | 'l' | 'I' | 'J' | '\'' | '|' => 0.30,
        ' ' | '.' | ',' | ':' | ';' | '/' | '\u{a0}' => 0.34,
        '-' | 'f' | 't' | '(' | ')' | '[' | ']' | '!' => 0.40,
        'r' | '"' => 0.46,
        '_' | '*' | '²' | '³' => 0.50,
        'c' | 's' | 'z' | '?' => 0.55,
        'k' | 'v' | 'x' | 'y' | 'F' | 'L' => 0.60,
        'a'..='z' | '0'..='9' | 'µ' | 'μ' => match letter {
            'm' => 0.98,
            'w' => 0.82,
            _ => 0.64,
        },
        'M' | '+' | '=' | '<' | '>' => 0.87,
        'W' | '%' | '@' | '#' | GAP => 1.0,
        'A'..='Z' => match letter {
            'D' | 'G' | 'H' | 'N' | 'O' | 'Q' | 'U' => 0.79,
            _ => 0.70,
        },
        // letters of Latin, Greek and Cyrillic
        '\u{80}'..='\u{5ff}' => 0.80,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_width_is_that_of_its_letters_and_is_wrapped_or_shortened() {
        assert!((width_px("10.5", 10.0) - 22.6).abs() < 1e-9);
        assert_eq!(wrapped("one two three", 10.0, 50.0), ["one two", "three"]);
        assert_eq!(wrapped("one", 10.0, 1.0), ["one"]);
        assert_eq!(shortened("sensor", 10.0, 100.0), "sensor");
        let short = shortened("a-sensor-of-a-batch-with-a-long-name-0003", 13.0, 120.0);
        assert!(short.starts_with("a-sens") && short.ends_with("0003") && short.contains(GAP), "{short}");
        assert!(width_px(&short, 13.0) <= 120.0);
        assert_eq!(shortened("wide", 13.0, 1.0), "…");
    }
}
