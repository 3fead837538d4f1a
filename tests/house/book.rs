//! The book in `docs/` and the README: links, summary, length of sentences, words, pictures.

use super::prose;
use palpate_testing::TestFolder;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Most words of the README, code and tables included.
const README_WORDS_MOST: usize = 900;
/// Most words of the pages that people write, without decisions and the index. What holds no letter and no digit isn't a word.
const BOOK_WORDS_MOST: usize = 26_000;
/// The page that `palpate study validation` writes.
const VALIDATION: &str = "docs/explanation/validation.md";
/// Most words of a sentence of the README, the tutorials, how-to and explanation.
const SENTENCE_WORDS_MOST: usize = 30;
/// Most bytes of a picture.
const PICTURE_BYTES_MOST: u64 = 200_000;

/// Unwanted words and phrases, in lower case. Code and links are not read.
const UNWANTED: [&str; 23] = [
    "told",
    "tell",
    "tells",
    "telling",
    "anew",
    "held against",
    "hold against",
    "is held",
    "whatever",
    "profits from",
    "profit from",
    "leave is taken",
    "stands",
    "says",
    "said",
    "say",
    "comes to",
    "come to",
    "ours",
    "lies",
    "by itself",
    "by themselves",
    "beside",
];

#[test]
fn every_relative_link_and_anchor_resolves() {
    let (mut links, mut broken) = (0, Vec::new());
    for page in pages() {
        for link in prose::links(&read(&page)) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            links += 1;
            if let Some(why) = broken_link(&page, &link) {
                broken.push(format!("{page}: {link}: {why}"));
            }
        }
    }
    println!("{links} relative links");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(links > 200, "only {links} links were found: does this test still read what is there?");
}

#[test]
fn the_readme_is_a_landing_page() {
    let words = read("README.md").split_whitespace().count();
    println!("{words} words");
    assert!(words <= README_WORDS_MOST, "README.md has {words} words, at most {README_WORDS_MOST} are allowed");
}

#[test]
fn book_can_be_read_to_its_end() {
    let not_read = |page: &str| page.starts_with("docs/decisions/") || page == "docs/SUMMARY.md";
    let by_program = |page: &str| made(page).is_some() || page == VALIDATION;
    let by_hand = |page: &String| page.starts_with("docs/") && !not_read(page) && !by_program(page);
    let words: usize = pages().iter().filter(|page| by_hand(page)).map(|page| prose::words(&read(page))).sum();
    println!("{words} words");
    assert!(words <= BOOK_WORDS_MOST, "the book has {words} words, at most {BOOK_WORDS_MOST} are allowed");
}

#[test]
fn sentences_are_short() {
    let short = ["README.md", "docs/README.md", "docs/tutorials/", "docs/how-to/", "docs/explanation/"];
    let (mut count, mut longest, mut long) = (0, 0, Vec::new());
    for page in pages().into_iter().filter(|page| short.iter().any(|start| page.starts_with(start))) {
        for sentence in prose::sentences(&read(&page)) {
            let words = prose::words(&sentence);
            (count, longest) = (count + 1, longest.max(words));
            if words > SENTENCE_WORDS_MOST {
                long.push(format!("{page}: {words} words: {sentence}"));
            }
        }
    }
    println!("{count} sentences, the longest of {longest} words");
    assert!(long.is_empty(), "{}", long.join("\n"));
    assert!(count > 150, "only {count} sentences were found: does this test still read what is there?");
}

#[test]
fn unwanted_words_do_not_come_back() {
    let read_here = |page: &String| page != VALIDATION;
    let mut found = Vec::new();
    for page in pages().into_iter().filter(read_here) {
        for (line, text) in prose::lines(&read(&page)) {
            found.extend(unwanted(&text).into_iter().map(|word| format!("{page}:{line}: `{word}` in: {text}")));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn every_page_is_in_the_summary() {
    let summary: BTreeSet<String> = prose::links(&read("docs/SUMMARY.md")).into_iter().collect();
    let missing: Vec<String> = pages()
        .into_iter()
        .filter_map(|page| page.strip_prefix("docs/").map(str::to_owned))
        .filter(|page| page != "SUMMARY.md" && !summary.contains(page))
        .collect();
    assert!(missing.is_empty(), "not in docs/SUMMARY.md: {}", missing.join(", "));
    println!("{} pages in the summary", summary.len());
}

#[test]
fn pictures_are_small_and_shown() {
    let shown: BTreeSet<PathBuf> =
        pages().iter().flat_map(|page| prose::links(&read(page)).into_iter().map(|link| target(page, &link))).collect();
    let mut pictures = 0;
    for entry in fs::read_dir(root().join("docs/pictures")).expect("docs/pictures can be read") {
        let path = entry.expect("an entry").path();
        if !path.extension().is_some_and(|extension| extension == "svg" || extension == "png") {
            continue;
        }
        pictures += 1;
        let bytes = path.metadata().expect("a file").len();
        assert!(bytes <= PICTURE_BYTES_MOST, "{}: {bytes} bytes", path.display());
        let name = path.strip_prefix(root()).expect("under the root");
        assert!(shown.contains(name), "no page shows {}", name.display());
    }
    assert!(pictures > 0, "docs/pictures has no picture");
}

#[test]
fn test_helpers_find_examples() {
    assert_eq!(unwanted("The page tells it. A foretelling"), ["tells"]);
    assert_eq!(unwanted("What comes to 3 mm; besides, it is held."), ["is held", "comes to"]);
    assert_eq!(broken_link("docs/README.md", "nowhere.md").as_deref(), Some("no such file"));
    assert_eq!(broken_link("docs/README.md", "explanation/verdicts.md#verdicts"), None);
    assert_eq!(broken_link("docs/README.md", "explanation/verdicts.md#verdict").as_deref(), Some("no such heading"));
}

/// Why a link of a page leads nowhere; none if it leads somewhere.
fn broken_link(page: &str, link: &str) -> Option<String> {
    let (path, anchor) = link.split_once('#').map_or((link, None), |(path, anchor)| (path, Some(anchor)));
    let target = if path.is_empty() { PathBuf::from(page) } else { target(page, path) };
    let name = target.to_string_lossy().replace('\\', "/");
    if !root().join(&target).exists() && made(&name).is_none() {
        return Some("no such file".to_owned());
    }
    let anchor = anchor?;
    let is_there = prose::anchors(&read(&name)).iter().any(|known| known == anchor);
    (!is_there).then(|| "no such heading".to_owned())
}

/// The file that a link of a page leads to, from the root.
fn target(page: &str, link: &str) -> PathBuf {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in link.split('#').next().unwrap_or_default().split('/') {
        match part {
            "." | "" => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.iter().collect()
}

/// The unwanted words of a text.
fn unwanted(text: &str) -> Vec<&'static str> {
    let plain: String = text.to_lowercase().chars().map(|c| if c.is_alphanumeric() { c } else { ' ' }).collect();
    let plain = format!(" {} ", plain.split_whitespace().collect::<Vec<_>>().join(" "));
    UNWANTED.into_iter().filter(|word| plain.contains(&format!(" {word} "))).collect()
}

/// README.md, ARCHITECTURE.md, data/README.md and every page under docs, from the root.
fn pages() -> Vec<String> {
    let (mut folders, mut pages) = (vec![root().join("docs")], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder of the book can be read") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                let name = path.strip_prefix(root()).expect("under the root");
                pages.push(name.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    pages.extend(["README.md", "ARCHITECTURE.md", "data/README.md"].map(str::to_owned));
    pages.extend(MADE.map(|name| format!("docs/reference/{name}.md")));
    pages.sort();
    pages.dedup();
    pages
}

/// The pages under docs/reference that the program makes.
const MADE: [&str; 11] = [
    "acceptance",
    "batch",
    "certificate",
    "columns",
    "commands",
    "line-profile",
    "protocols",
    "recipe",
    "register-map",
    "rig",
    "safety-rules",
];

/// The name of a page that the program makes.
fn made(page: &str) -> Option<&str> {
    let name = page.strip_prefix("docs/reference/")?.strip_suffix(".md")?;
    MADE.contains(&name).then_some(name)
}

fn read(page: &str) -> String {
    if let Some(name) = made(page) {
        return TestFolder::new().palpate_ends(0, &format!("reference {name}")).out;
    }
    fs::read_to_string(root().join(page)).unwrap_or_else(|error| panic!("{page}: {error}"))
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}
