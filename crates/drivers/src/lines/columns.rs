//! Lists of columns, such as `2-4, 6-8`.

use super::keys::COLUMNS_MAX;

/// Reads a list of columns: numbers from 1 and ranges, separated by commas. Returns them from 0, in their order; `None` if it is
/// anything else, or names more than the largest number of columns.
pub(super) fn columns(text: &str) -> Option<Vec<usize>> {
    let number = |text: &str| text.trim().parse::<u64>().ok().filter(|column| (1..=COLUMNS_MAX).contains(column));
    let mut columns = Vec::new();
    for part in text.split(',') {
        let (first, last) = match part.split_once('-') {
            Some((first, last)) => (number(first)?, number(last)?),
            None => (number(part)?, number(part)?),
        };
        columns.extend((first..=last).map(|column| column as usize - 1));
        if first > last || columns.len() as u64 > COLUMNS_MAX {
            return None;
        }
    }
    Some(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_numbers_and_ranges() {
        assert_eq!(columns("2-4, 6"), Some(vec![1, 2, 3, 5]));
        assert_eq!(columns("3,1"), Some(vec![2, 0]));
        for text in ["", "0", "a", "4-2", "1-", "1-9999999999", "1,,2", "1025"] {
            assert_eq!(columns(text), None, "{text}");
        }
    }
}
