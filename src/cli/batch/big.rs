//! Words in block letters, which can be read from the other side of a bench.

use palpate_run::batch::SensorState;

/// Number of rows of a letter.
const ROWS: usize = 5;

/// Largest number of columns of a line.
const COLUMNS: usize = 40;

/// Returns a standing in block letters of at most 40 columns, one line of letters for each word. A longer word is plain text.
pub(super) fn big(sensor_state: SensorState) -> String {
    let words = sensor_state.name().to_uppercase();
    words.split(' ').map(|word| block(word).unwrap_or_else(|| format!("{word}\n"))).collect::<Vec<_>>().join("\n")
}

/// Returns a word in block letters; `None` if it doesn't fit.
fn block(word: &str) -> Option<String> {
    let letters: Vec<[&str; ROWS]> = word.chars().map(letter).collect();
    let row = |row: usize| {
        let line = letters.iter().map(|letter| letter[row]).collect::<Vec<_>>().join(" ");
        (line.len() <= COLUMNS).then(|| format!("{}\n", line.trim_end()))
    };
    (0..ROWS).map(row).collect()
}

/// Returns the rows of a letter; a letter that no standing contains is a block.
fn letter(letter: char) -> [&'static str; ROWS] {
    match letter {
        'A' => [" ## ", "#  #", "####", "#  #", "#  #"],
        'B' => ["### ", "#  #", "### ", "#  #", "### "],
        'C' => [" ###", "#   ", "#   ", "#   ", " ###"],
        'D' => ["### ", "#  #", "#  #", "#  #", "### "],
        'E' => ["####", "#   ", "### ", "#   ", "####"],
        'F' => ["####", "#   ", "### ", "#   ", "#   "],
        'I' => ["#", "#", "#", "#", "#"],
        'L' => ["#   ", "#   ", "#   ", "#   ", "####"],
        'N' => ["#  #", "## #", "# ##", "#  #", "#  #"],
        'O' => [" ## ", "#  #", "#  #", "#  #", " ## "],
        'P' => ["### ", "#  #", "### ", "#   ", "#   "],
        'R' => ["### ", "#  #", "### ", "# # ", "#  #"],
        'T' => ["###", " # ", " # ", " # ", " # "],
        _ => ["####", "####", "####", "####", "####"],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_result_fits_40_columns_with_known_letters() {
        for sensor_state in SensorState::ALL
            .into_iter()
            .filter(|sensor_state| sensor_state.is_judged() || *sensor_state == SensorState::Failed)
        {
            let text = big(sensor_state);
            assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
            let unknown = letter('?');
            assert!(
                sensor_state.name().to_uppercase().replace(' ', "").chars().all(|c| letter(c) != unknown),
                "{sensor_state:?}"
            );
        }
        assert_eq!(
            big(SensorState::NotAccepted).lines().filter(|line| line.is_empty()).count(),
            1,
            "two words, two lines"
        );
        assert_eq!(big(SensorState::Accepted).lines().next(), Some(" ##   ###  ### #### ###  ### #### ###"));
        assert_eq!(big(SensorState::Interrupted), "INTERRUPTED\n");
    }
}
