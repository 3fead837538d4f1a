//! Printed or drawn output for a person: narrow enough and complete.

/// Every line fits a terminal.
pub fn is_narrow(text: &str) {
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
}

/// Every element is closed in order, no number is missing, and something is drawn.
pub fn is_well_formed(name: &str, svg: &str) {
    assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\"") && svg.ends_with("</svg>\n"), "{name}");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name}");
    assert!(svg.contains("prefers-color-scheme:dark") && svg.contains("class=\"axis\""), "{name}");
    let (mut open, mut rest) = (Vec::new(), svg);
    while let Some(start) = rest.find('<') {
        let end = rest[start..].find('>').unwrap_or_else(|| panic!("{name}: an element without an end")) + start;
        let element = &rest[start + 1..end];
        assert_eq!(element.matches('"').count() % 2, 0, "{name}: {element}");
        if let Some(ended) = element.strip_prefix('/') {
            assert_eq!(open.pop(), Some(ended), "{name}");
        } else if !element.ends_with('/') {
            open.extend(element.split_whitespace().next());
        }
        rest = &rest[end + 1..];
    }
    assert!(open.is_empty(), "{name}: {open:?} never end");
}
