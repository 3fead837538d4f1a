//! Pages of the book whose commands need Python.
#![cfg(unix)]

use palpate_testing::book::{needs_python, pages, try_pages};
use palpate_testing::there;
use std::process::Command;

#[test]
#[ignore = "needs python3"]
fn every_block_of_the_pages_with_python_works() {
    there(Command::new("python3").arg("--version"), "python3");
    let mut pages = pages();
    pages.retain(|page| needs_python(page));
    let (commands, _) = try_pages(&pages);
    assert!(pages.len() >= 3 && commands >= 3, "{commands} commands of {pages:?}");
}
