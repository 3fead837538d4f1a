//! HTTP/1.1 as far as clients of Moonraker use it: requests in a stream of bytes, and answers.

/// Largest head of a request, bytes (Tornado's `max_header_size`).
const HEAD_MOST: usize = 65_536;
/// Largest body of a request here, bytes. Moonraker takes more, for files.
const BODY_MOST: usize = 1 << 20;
/// Status of the answer to anything that isn't a request.
const BAD: &str = "400 Bad Request";

/// Takes the first complete request from what was received. What can't become a request is taken, too.
pub(super) fn take(received: &mut Vec<u8>) -> Option<Vec<u8>> {
    let whole = received.len();
    let length = match split(received) {
        None if whole <= HEAD_MOST => return None,
        split => split.and_then(|(head, body)| Some(whole - body.len() + body_length(&head)?)).unwrap_or(whole),
    };
    (whole >= length).then(|| received.drain(..length).collect())
}

/// Returns the JSON of a request, and whether the connection ends after its answer. The error is the status of a refusal.
pub(super) fn read(request: &[u8]) -> Result<(&[u8], bool), &'static str> {
    let (head, body) = split(request).ok_or(BAD)?;
    let is_json = field(&head, "content-type").is_some_and(|kind| kind.starts_with("application/json"));
    let mut words = head.lines().next().unwrap_or_default().split(' ');
    match (words.next(), words.next()) {
        (Some("POST"), Some("/server/jsonrpc")) if is_json && body_length(&head).is_some() => {
            Ok((body, field(&head, "connection").is_some_and(|value| value.eq_ignore_ascii_case("close"))))
        }
        (_, Some("/server/jsonrpc") | None) => Err(BAD),
        _ => Err("404 Not Found"),
    }
}

/// Returns an answer.
pub(super) fn answer(status: &str, body: &str, closes: bool) -> Vec<u8> {
    let (length, close) = (body.len(), if closes { "Connection: close\r\n" } else { "" });
    let kind = "application/json; charset=UTF-8";
    format!("HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{close}\r\n{body}").into_bytes()
}

/// Splits a request into its head, if that is complete, and what follows.
fn split(bytes: &[u8]) -> Option<(String, &[u8])> {
    let (head, rest) = bytes.split_at(bytes.windows(4).position(|end| end == b"\r\n\r\n")? + 4);
    Some((String::from_utf8_lossy(head).into_owned(), rest))
}

/// Stated length of the body, bytes. `None` if it can't be read.
fn body_length(head: &str) -> Option<usize> {
    let is_whole = field(head, "transfer-encoding").is_none();
    field(head, "content-length").unwrap_or("0").parse().ok().filter(|&length| is_whole && length <= BODY_MOST)
}

/// Value of a field of the head.
fn field<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    let mut fields = head.lines().filter_map(|line| line.split_once(':'));
    fields.find(|(other, _)| other.eq_ignore_ascii_case(name)).map(|(_, value)| value.trim())
}
