//! `best` compared with regressions of scikit-learn on the shipped example.

use palpate_testing::python::{Python, said};
use palpate_testing::{TestFolder, shipped};

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn best_is_more_accurate_than_regressions_of_another_program() {
    let python = Python::with("import numpy, sklearn");
    let program = TestFolder::new().command("").get_program().to_owned();
    let words = [program, shipped("data/example").into_os_string()];
    let printed = said(python.script("references.py", words));
    let ratio: f64 = printed.trim().rsplit(' ').next().and_then(|word| word.parse().ok()).expect("the largest ratio");
    println!("{printed}");
    assert!(printed.contains("best (surrogate)") && ratio <= 0.97, "{printed}");
}
