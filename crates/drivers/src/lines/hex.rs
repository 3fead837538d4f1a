//! Bytes in a profile, as hexadecimal text.

/// Reads pairs of hexadecimal digits with blanks between them, such as `AA 55`; `None` if it is anything else.
pub(super) fn bytes(text: &str) -> Option<Vec<u8>> {
    let is_pair = |pair: &str| pair.len() == 2 && pair.bytes().all(|byte| byte.is_ascii_hexdigit());
    text.split_whitespace().map(|pair| is_pair(pair).then(|| u8::from_str_radix(pair, 16).ok())?).collect()
}
