//! The promises of `docs/promises.md`: each line names tests that are there.

use std::fs;
use std::path::Path;

/// Fewest promises that the table makes: an empty one would keep all of them.
const PROMISES_LEAST: usize = 20;

#[test]
fn every_promise_names_a_test_that_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    let page = read("docs/promises.md");
    let mut promises = 0;
    for line in page.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| what happens")) {
        let cell = line.trim_end_matches('|').rsplit('|').next().unwrap_or_default();
        let named: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "no test is named in: {line}");
        for name in named {
            let (file, test) = name.rsplit_once("::").unwrap_or_else(|| panic!("{name} is no FILE::TEST"));
            assert!(read(file).contains(&format!("fn {test}(")), "{file} has no test {test}");
        }
        promises += 1;
    }
    assert!(promises >= PROMISES_LEAST, "{promises} promises");
}
