//! Colours for numbers.

/// Colours for a quantity: from dark blue through greys to light yellow, with increasing lightness. They keep their order in grey
/// print and for colour-blind people (after the idea of cividis: Nunez, Anderton and Renslow 2018).
pub(crate) struct Ramp;

/// Number of colours.
pub(super) const LEVELS: usize = 16;

/// Red, green and blue at equal steps.
const ANCHORS: [[f64; 3]; 5] =
    [[0.0, 34.0, 78.0], [65.0, 77.0, 107.0], [124.0, 123.0, 120.0], [188.0, 175.0, 111.0], [254.0, 232.0, 56.0]];

impl Ramp {
    /// Returns the level of the colour for a fraction from 0 to 1.
    pub(crate) fn level(share: f64) -> usize {
        ((share.clamp(0.0, 1.0) * LEVELS as f64) as usize).min(LEVELS - 1)
    }

    /// Returns the class of elements with this colour.
    pub(crate) fn class(level: usize) -> String {
        format!("c{level}")
    }

    /// Returns the style sheet of these classes.
    pub(crate) fn style() -> String {
        let rule = |level| format!(".{}{{fill:{}}}", Ramp::class(level), colour(level));
        (0..LEVELS).map(rule).collect()
    }
}

fn colour(level: usize) -> String {
    let at = level as f64 / (LEVELS - 1) as f64 * (ANCHORS.len() - 1) as f64;
    let below = (at as usize).min(ANCHORS.len() - 2);
    let part = |i: usize| ANCHORS[below][i] + (at - below as f64) * (ANCHORS[below + 1][i] - ANCHORS[below][i]);
    let [r, g, b] = [0, 1, 2].map(|i| part(i).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_a_ramp_get_lighter() {
        let luminance = |level| {
            let colour = colour(level);
            let part = |from: usize| f64::from(u8::from_str_radix(&colour[from..from + 2], 16).unwrap());
            0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5)
        };
        assert!((1..LEVELS).all(|level| luminance(level) > luminance(level - 1) + 5.0));
        assert_eq!([-1.0, 0.0, 0.5, 0.999, 1.0, 2.0].map(Ramp::level), [0, 0, 8, 15, 15, 15]);
    }
}
