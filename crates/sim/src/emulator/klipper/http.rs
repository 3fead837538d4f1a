//! HTTP/1.1 as Moonraker's server speaks it (Tornado): requests in a stream of bytes, and answers.

/// Largest head of a request, bytes (Tornado's `max_header_size`).
const HEAD_MOST: usize = 65_536;
/// Largest body of a request here, bytes. Moonraker takes more, for files.
const BODY_MOST: usize = 1 << 20;

/// Collects the bytes of requests. An inbox is too small for the longest ones.
#[derive(Default)]
pub(super) struct HttpReader(Vec<u8>);

impl HttpReader {
    /// Takes all bytes of an inbox, and returns the first complete request. What can't become a request is returned, too.
    pub(super) fn take(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.0.append(inbox);
        let Some(head) = head_length(&self.0) else {
            return (self.0.len() > HEAD_MOST).then(|| std::mem::take(&mut self.0));
        };
        let body = match HttpRequest::parse(&self.0[..head]) {
            Some(request) => request.length,
            None => return Some(std::mem::take(&mut self.0)),
        };
        (self.0.len() >= head + body).then(|| self.0.drain(..head + body).collect())
    }
}

/// A request.
pub(super) struct HttpRequest<'a> {
    pub method: &'a str,
    pub path: &'a str,
    /// Names and values of the query, decoded.
    pub query: Vec<(String, String)>,
    /// Whether the body is stated to be JSON.
    pub json: bool,
    pub body: &'a [u8],
    /// Whether the connection ends after the answer.
    pub closes: bool,
    /// Stated length of the body, bytes.
    length: usize,
}

impl<'a> HttpRequest<'a> {
    /// Parses a request. `None` if it is none.
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let head = head_length(bytes)?;
        let mut lines = std::str::from_utf8(&bytes[..head]).ok()?.trim_end().split("\r\n");
        let mut first = lines.next()?.split(' ');
        let (method, target, version) = (first.next()?, first.next()?, first.next()?);
        if !version.starts_with("HTTP/1.") || first.next().is_some() {
            return None;
        }
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let pair = |pair: &str| {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            (decoded(name), decoded(value))
        };
        let query = query.split('&').filter(|text| !text.is_empty()).map(pair).collect();
        let closes = version == "HTTP/1.0";
        let mut request = HttpRequest { method, path, query, json: false, body: &bytes[head..], closes, length: 0 };
        for line in lines {
            let (name, value) = line.split_once(':')?;
            let value = value.trim();
            match name.to_ascii_lowercase().as_str() {
                "content-length" => request.length = value.parse().ok().filter(|&length| length <= BODY_MOST)?,
                "content-type" => request.json = value.starts_with("application/json"),
                "connection" => request.closes = value.eq_ignore_ascii_case("close"),
                "transfer-encoding" => return None,
                _ => {}
            }
        }
        Some(request)
    }
}

/// Returns an answer. `reason` is the text beside the code. An answer without a body is no JSON.
pub(super) fn answer(code: i64, reason: &str, body: &str, closes: bool, now_s: f64) -> Vec<u8> {
    let kind = if body.is_empty() { "text/html" } else { "application/json" };
    let close = if closes { "Connection: close\r\n" } else { "" };
    // a text with several lines can't stand in the head
    let (reason, date, length) = (reason.replace(['\r', '\n'], " "), date(now_s), body.len());
    format!(
        "HTTP/1.1 {code} {reason}\r\nServer: TornadoServer/6.4.0\r\nContent-Type: {kind}; charset=UTF-8\r\nDate: {date}\r\n\
         Content-Length: {length}\r\n{close}\r\n{body}"
    )
    .into_bytes()
}

/// Returns Tornado's answer to what is no request.
pub(super) fn refusal() -> Vec<u8> {
    b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec()
}

/// Time of a day, which is the same on each day here.
fn date(now_s: f64) -> String {
    let second = now_s as u64;
    let (hour, minute) = (second / 3600 % 24, second / 60 % 60);
    format!("Mon, 01 Jan 2024 {hour:02}:{minute:02}:{:02} GMT", second % 60)
}

/// Length of the head with the empty line, if it is complete.
fn head_length(bytes: &[u8]) -> Option<usize> {
    bytes.windows(4).position(|end| end == b"\r\n\r\n").map(|at| at + 4)
}

/// Decodes a part of a query: `+` is a blank, and `%` is followed by two hexadecimal digits.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((&byte, left)) = rest.split_first() {
        let hex = left.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
        match (byte, hex.and_then(|hex| u8::from_str_radix(hex, 16).ok())) {
            (b'%', Some(value)) => {
                bytes.push(value);
                rest = &left[2..];
                continue;
            }
            (b'+', _) => bytes.push(b' '),
            _ => bytes.push(byte),
        }
        rest = left;
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
