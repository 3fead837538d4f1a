//! The promises of `docs/explanation/promises.md`: each has a number, and `tests/house/promises.md` names tests of it that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Fewest promises in the tables, because empty tables would pass.
const PROMISES_LEAST: usize = 50;

#[test]
fn every_promise_has_tests_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    let numbered = |page: &str| -> Vec<(usize, String)> {
        let row = |line: &str| {
            let (number, rest) = line.strip_prefix("| ")?.split_once(" | ")?;
            Some((number.parse().ok()?, rest.to_owned()))
        };
        read(page).lines().filter_map(row).collect()
    };
    let promised: BTreeSet<usize> =
        numbered("docs/explanation/promises.md").into_iter().map(|(number, _)| number).collect();
    let tested = numbered("tests/house/promises.md");
    assert_eq!(promised, tested.iter().map(|(number, _)| *number).collect());
    assert!(promised.len() >= PROMISES_LEAST, "{} promises", promised.len());
    for (number, cell) in tested {
        let named: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "no test is named for promise {number}");
        for name in named {
            let (file, test) = name.rsplit_once("::").unwrap_or_else(|| panic!("{name} is no FILE::TEST"));
            assert!(read(file).contains(&format!("fn {test}(")), "{file} has no test {test}");
        }
    }
}
