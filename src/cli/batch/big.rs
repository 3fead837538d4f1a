//! Words in block letters, which can be read from the other side of a bench.

use palpate_run::batch::SensorState;

/// Number of rows of a letter.
const ROWS: usize = 5;

/// Largest number of columns of a line.
const COLUMNS: usize = 40;

/// Returns a standing in block letters of at most 40 columns, one line of letters for each word. A longer word is plain text.
pub(super) fn big(standing: SensorState) -> String {
    let words = standing.name().to_uppercase();
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
    fn every_result_fits_forty_columns_and_has_all_its_letters() {
        for standing in
            SensorState::ALL.into_iter().filter(|standing| standing.is_judged() || *standing == SensorState::Failed)
        {
            let text = big(standing);
            assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
            let unknown = letter('?');
            assert!(
                standing.name().to_uppercase().replace(' ', "").chars().all(|c| letter(c) != unknown),
                "{standing:?}"
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
