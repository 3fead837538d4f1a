//! The Markdown that tests read: prose without code, sentences, links, anchors.

/// The lines of prose with their numbers: no fenced code; code spans and targets of links are cut out.
pub(crate) fn lines(text: &str) -> Vec<(usize, String)> {
    outside_fences(text).into_iter().map(|(line, text)| (line, without_code(&without_targets(text)))).collect()
}

/// The sentences of a text, ended by a full stop, a colon, a semicolon, a question or exclamation mark, or with their
/// paragraph or item of a list. Headings and tables are left out. A code span counts as a word.
pub(crate) fn sentences(text: &str) -> Vec<String> {
    let (mut paragraphs, mut paragraph) = (Vec::new(), String::new());
    for (_, line) in outside_fences(text) {
        let line = line.trim();
        let is_item = line.starts_with("- ") || line.starts_with("* ") || is_numbered(line);
        let is_left_out = line.starts_with('#') || line.starts_with('|') || line.starts_with('<');
        if line.is_empty() || is_item || is_left_out {
            paragraphs.push(std::mem::take(&mut paragraph));
        }
        if !is_left_out {
            paragraph += &format!("{} ", spans_as_words(&without_targets(line)));
        }
    }
    paragraphs.push(paragraph);
    paragraphs.iter().flat_map(|paragraph| split(paragraph)).collect()
}

/// Number of words in a sentence. A word has a letter or a digit.
pub(crate) fn words(sentence: &str) -> usize {
    sentence.split_whitespace().filter(|word| word.chars().any(char::is_alphanumeric)).count()
}

/// The targets of all inline links and pictures outside of code.
pub(crate) fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (_, line) in outside_fences(text) {
        let line = without_code(line);
        for (at, _) in line.match_indices("](") {
            let rest = &line[at + 2..];
            found.extend(rest.find(')').map(|end| rest[..end].to_owned()));
        }
    }
    found
}

/// The anchors of a text's headings, as GitHub makes them.
pub(crate) fn anchors(text: &str) -> Vec<String> {
    let heading = |line: &str| {
        let title = line.trim_start_matches('#');
        (title.len() < line.len() && title.starts_with(' ')).then(|| slug(&without_targets(title.trim())))
    };
    outside_fences(text).into_iter().filter_map(|(_, line)| heading(line)).collect()
}

fn slug(title: &str) -> String {
    let kept = title.to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The lines outside of fenced code.
fn outside_fences(text: &str) -> Vec<(usize, &str)> {
    let (mut lines, mut inside) = (Vec::new(), false);
    for (at, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
        } else if !inside {
            lines.push((at + 1, line));
        }
    }
    lines
}

/// `[text](target)` and `![text](target)` as `text`.
fn without_targets(line: &str) -> String {
    let (mut kept, mut rest) = (String::new(), line);
    while let Some(at) = rest.find("](") {
        let Some(end) = rest[at..].find(')') else { break };
        kept += &rest[..at];
        rest = &rest[at + end + 1..];
    }
    (kept + rest).replace("![", "").replace('[', "")
}

/// Code spans cut out.
fn without_code(line: &str) -> String {
    line.split('`').step_by(2).collect::<Vec<_>>().join(" ")
}

/// Each code span as one word, without characters that end a sentence.
fn spans_as_words(line: &str) -> String {
    let parts = line.split('`').enumerate();
    parts.map(|(at, part)| if at % 2 == 1 { "code".to_owned() } else { part.to_owned() }).collect()
}

/// `1. `, `12. `
fn is_numbered(line: &str) -> bool {
    line.split_once(". ").is_some_and(|(number, _)| !number.is_empty() && number.chars().all(|c| c.is_ascii_digit()))
}

/// A paragraph's sentences. A mark within a word, as in 0.5, doesn't end one.
fn split(paragraph: &str) -> Vec<String> {
    let (mut sentences, mut sentence) = (Vec::new(), Vec::new());
    for word in paragraph.split_whitespace() {
        sentence.push(word);
        if word.trim_end_matches(['*', ')', '"', '_']).ends_with(['.', ':', ';', '?', '!']) {
            sentences.push(sentence.join(" "));
            sentence.clear();
        }
    }
    sentences.extend((!sentence.is_empty()).then(|| sentence.join(" ")));
    sentences
}

#[test]
fn prose_is_found() {
    let text = "# A `b` (c), d\n\nOne [two](three.md#x) 0.5 mm: three `a. b`\nfour. Five\n\n| a | b |\n- six\n- seven; eight\n```sh\nnine\n```\n";
    let expected = ["One two 0.5 mm:", "three code four.", "Five", "- six", "- seven;", "eight"];
    assert_eq!(sentences(text), expected);
    assert_eq!(words("- seven;"), 1);
    assert_eq!(links(text), ["three.md#x"]);
    assert_eq!(anchors(text), ["a-b-c-d"]);
    assert!(lines(text).iter().all(|(_, line)| !line.contains("nine") && !line.contains("three.md")));
}
