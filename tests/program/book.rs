//! The examples of the book work: commands are run, recipes and rigs are checked.
#![cfg(unix)]

use palpate_testing::book::{blocks, needs_python, pages, try_pages};
use palpate_testing::campaign;

/// Least number of commands and checked files, because a test that reads nothing would pass.
const COMMANDS_LEAST: usize = 35;
const FILES_LEAST: usize = 6;

/// The pages that need nothing but the program; pages that need Python are tried in `tests/outside`.
#[test]
fn every_block_of_readme_tutorials_and_how_to_works() {
    let mut pages = pages();
    pages.retain(|page| !needs_python(page));
    if campaign::is_quick() {
        pages.retain(|page| QUICK.contains(&page.as_str()));
        let (commands, _) = try_pages(&pages);
        assert!(pages.len() == QUICK.len() && commands > 0, "{commands} commands of {pages:?}");
        return;
    }
    let (commands, files) = try_pages(&pages);
    assert!(commands >= COMMANDS_LEAST && files >= FILES_LEAST, "{commands} commands, {files} files");
}

/// The page that is tried in the quick tier.
const QUICK: [&str; 1] = ["README.md"];

#[test]
fn blocks_are_found() {
    let text = "text\n```console exit=2\n$ palpate check \\\n    x.toml\nerror\n$ ls\n```\n\n- item\n  ```toml rig file=r.toml\n  a = 1\n  ```\n";
    let blocks = blocks(text);
    assert_eq!(blocks.len(), 2);
    assert_eq!((blocks[0].kind(), blocks[0].option("exit")), ("console", Some("2")));
    assert_eq!(blocks[0].commands(), ["palpate check \\\n    x.toml", "ls"]);
    assert_eq!((blocks[1].text.as_str(), blocks[1].option("file")), ("a = 1\n", Some("r.toml")));
    assert!(blocks[1].has("rig") && !blocks[0].has("rig"));
}
