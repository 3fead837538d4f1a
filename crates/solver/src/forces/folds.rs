//! Parts of a table that are left out in turn. Whole groups stay together.

use super::ForceTable;
use std::collections::BTreeMap;

/// Returns positions in `rows` in at most `most` parts. Each part has whole groups, and the parts have about equally many rows. The rows of a
/// single group are cut into parts in their order; so are all rows if groups may be divided and one has more than half of the rows.
pub(super) fn folds(table: &ForceTable, rows: &[usize], most: usize, must_be_whole: bool) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (at, &row) in rows.iter().enumerate() {
        groups.entry(table.groups[row]).or_default().push(at);
    }
    if groups.len() == 1 {
        return blocks(rows.len(), most);
    }
    let mut groups: Vec<Vec<usize>> = groups.into_values().collect();
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let mut parts: Vec<Vec<usize>> = vec![Vec::new(); most.min(groups.len())];
    for group in groups {
        if let Some(smallest) = parts.iter_mut().min_by_key(|part| part.len()) {
            smallest.extend(group);
        }
    }
    // one group may be nearly everything: too little would remain to fit
    let largest = parts.iter().map(Vec::len).max().unwrap_or(0);
    if must_be_whole || 2 * largest <= rows.len() { parts } else { blocks(rows.len(), most) }
}

/// Returns positions of rows in parts, in their order.
pub(crate) fn blocks(rows: usize, most: usize) -> Vec<Vec<usize>> {
    (0..rows).collect::<Vec<_>>().chunks(rows.div_ceil(most).max(1)).map(<[usize]>::to_vec).collect()
}

/// Returns the rows that aren't in a part.
pub(crate) fn without(rows: &[usize], part: &[usize]) -> Vec<usize> {
    let mut is_left = vec![true; rows.len()];
    part.iter().for_each(|&at| is_left[at] = false);
    rows.iter().zip(is_left).filter(|(_, is_left)| *is_left).map(|(row, _)| *row).collect()
}
