//! Requests and replies as transmitted.

use super::errors::Code;

/// Longest reply. Existing clients assume that one segment of this size is the complete reply.
pub(super) const REPLY_MOST: usize = 1024;
/// Longest request. A reply echoes it, with a code before it and the end mark after it.
pub(super) const REQUEST_MOST: usize = 1000;
/// End of every reply. Some clients also send it after their requests.
const END: &[u8] = b",EndOfAPI";
/// Number of significant digits of a number (EPICS uses `%.13g`).
const DIGITS: i32 = 13;

/// One call: `Name(argument,argument,type *)`. Its arguments are taken one after another.
#[derive(Debug, PartialEq)]
pub(super) struct Call<'a> {
    pub name: &'a str,
    arguments: Vec<&'a str>,
    taken: usize,
}

/// Type that a call states for its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    Char,
    Double,
    Int,
}

/// Takes the next request: up to its balanced `)`. There is no other end. Rests of line ends and of `,EndOfAPI` before the
/// request are ignored. A line that doesn't end with its closing parenthesis, or is too long, is refused: it can't be a request.
pub(super) fn take_request(inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
    let lead = lead(inbox);
    inbox.drain(..lead);
    let mut depth = 0;
    for (n, &byte) in inbox.iter().enumerate() {
        match byte {
            b'(' => depth += 1,
            b')' if depth <= 1 => return Some(inbox.drain(..=n).collect()),
            b')' => depth -= 1,
            b'\r' | b'\n' if depth == 0 => return Some(inbox.drain(..n).collect()),
            _ => {}
        }
    }
    (inbox.len() > REQUEST_MOST).then(|| std::mem::take(inbox))
}

/// Returns a reply with the results of a call, values separated by commas.
pub(super) fn done(values: &str) -> Vec<u8> {
    format!("0,{values},EndOfAPI").into_bytes()
}

/// Returns a reply with an error, and the request as received.
pub(super) fn failed(code: Code, request: &[u8]) -> Vec<u8> {
    let mut reply = format!("{},", code.0).into_bytes();
    let room = REPLY_MOST - reply.len() - END.len();
    reply.extend(&request[..request.len().min(room)]);
    reply.extend(END);
    reply
}

/// Formats a number as `%.13g` does.
pub(super) fn number(value: f64) -> String {
    let scientific = format!("{:.*e}", DIGITS as usize - 1, value + 0.0);
    let Some((mantissa, exponent)) = scientific.split_once('e') else { return scientific };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..DIGITS).contains(&exponent) {
        return bare(&format!("{:.*}", (DIGITS - 1 - exponent) as usize, value + 0.0)).into();
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{}e{sign}{:02}", bare(mantissa), exponent.abs())
}

/// Formats numbers, separated by commas.
pub(super) fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(number).collect::<Vec<_>>().join(",")
}

impl<'a> Call<'a> {
    /// Parses the call of a request.
    pub(super) fn read(request: &'a [u8]) -> Result<Self, Code> {
        if request.len() > REQUEST_MOST {
            return Err(Code::STRING_TOO_LONG);
        }
        let text = std::str::from_utf8(request).map_err(|_| Code::WRONG_FORMAT)?;
        let (name, rest) = text.split_once('(').ok_or(Code::WRONG_FORMAT)?;
        let arguments = rest.strip_suffix(')').ok_or(Code::WRONG_FORMAT)?.trim();
        let name = name.trim();
        if name.is_empty() || !name.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            return Err(Code::WRONG_FORMAT);
        }
        let arguments = if arguments.is_empty() { Vec::new() } else { arguments.split(',').map(str::trim).collect() };
        Ok(Call { name, arguments, taken: 0 })
    }

    /// Returns the next argument unchanged.
    pub(super) fn text(&mut self) -> Result<&'a str, Code> {
        let text = self.arguments.get(self.taken).ok_or(Code::WRONG_COUNT)?;
        self.taken += 1;
        Ok(text)
    }

    /// Returns the next argument as a number.
    pub(super) fn number(&mut self) -> Result<f64, Code> {
        let value: f64 = self.text()?.parse().map_err(|_| Code::WRONG_DOUBLE)?;
        if value.is_finite() { Ok(value) } else { Err(Code::WRONG_DOUBLE) }
    }

    /// Returns the next argument as an integer.
    pub(super) fn whole(&mut self) -> Result<i32, Code> {
        self.text()?.parse().map_err(|_| Code::WRONG_INT)
    }

    /// Checks that the next arguments name `count` results of a type and that nothing follows. The position of blanks in `double
    /// *` doesn't matter.
    pub(super) fn results(mut self, results: Type, count: usize) -> Result<(), Code> {
        for _ in 0..count {
            self.result(results)?;
        }
        self.end()
    }

    /// Checks that the next argument names a result.
    pub(super) fn result(&mut self, result: Type) -> Result<(), Code> {
        let (name, code) = match result {
            Type::Char => ("char", Code::WRONG_CHAR),
            Type::Double => ("double", Code::WRONG_DOUBLE),
            Type::Int => ("int", Code::WRONG_INT),
        };
        let given = self.text()?.strip_suffix('*').map(str::trim_end);
        if given == Some(name) { Ok(()) } else { Err(code) }
    }

    /// Checks that nothing follows.
    pub(super) fn end(self) -> Result<(), Code> {
        if self.is_through() { Ok(()) } else { Err(Code::WRONG_COUNT) }
    }

    /// Whether all arguments have been taken.
    pub(super) fn is_through(&self) -> bool {
        self.taken == self.arguments.len()
    }
}

/// Number of bytes at the front of the inbox without meaning.
fn lead(inbox: &[u8]) -> usize {
    let mut lead = 0;
    loop {
        lead += inbox[lead..].iter().take_while(|byte| byte.is_ascii_whitespace() || **byte == 0).count();
        if !inbox[lead..].starts_with(END) {
            return lead;
        }
        lead += END.len();
    }
}

/// Removes the trailing zeros after the decimal point.
fn bare(number: &str) -> &str {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn requests(bytes: &[u8]) -> (Vec<String>, Vec<u8>) {
        let mut inbox = bytes.to_vec();
        let taken =
            std::iter::from_fn(|| take_request(&mut inbox)).map(|r| String::from_utf8_lossy(&r).into()).collect();
        (taken, inbox)
    }

    #[test]
    fn a_request_ends_with_its_balanced_parenthesis() {
        let (taken, left) = requests(b"A(b)C (d,double *),EndOfAPI\r\nE((f)g)\r\n ,EndOfAPI \0H(i");
        assert_eq!(taken, ["A(b)", "C (d,double *)", "E((f)g)"]);
        assert_eq!(left, b"H(i");
        assert_eq!(requests(b"A(b),EndOf"), (vec!["A(b)".into()], b",EndOf".to_vec()));
    }

    #[test]
    fn malformed_request_is_answered_with_an_error() {
        let (taken, left) = requests(b"*IDN?\r\n)A(b\r\nc)");
        assert_eq!((taken, left.as_slice()), (vec!["*IDN?".into(), ")".into(), "A(b\r\nc)".into()], &b""[..]));
        for bad in ["*IDN?", ")", "(a)", "A", "A(b", "A b(c)", "A(b)c"] {
            assert_eq!(Call::read(bad.as_bytes()), Err(Code::WRONG_FORMAT), "{bad}");
        }
        let (taken, left) = requests(&[b'x'; REQUEST_MOST + 1]);
        assert_eq!(Call::read(taken[0].as_bytes()), Err(Code::STRING_TOO_LONG));
        assert!(left.is_empty());
    }

    #[test]
    fn arguments_of_clients_are_accepted() {
        for text in ["F(G,1.5,-2,char *)", "F (G, 1.5, -2, char*)", "F( G ,+1.5e0 ,-2 , char  * )"] {
            let mut call = Call::read(text.as_bytes()).expect("a call");
            assert_eq!(
                (call.name, call.text(), call.number(), call.whole()),
                ("F", Ok("G"), Ok(1.5), Ok(-2)),
                "{text}"
            );
            assert_eq!(call.results(Type::Char, 1), Ok(()), "{text}");
        }
        let call = |text: &'static str| Call::read(text.as_bytes()).expect("a call");
        assert_eq!(call("F(x)").number(), Err(Code::WRONG_DOUBLE));
        assert_eq!(call("F(nan)").number(), Err(Code::WRONG_DOUBLE));
        assert_eq!(call("F(1.5)").whole(), Err(Code::WRONG_INT));
        assert_eq!(call("F(double *)").results(Type::Int, 1), Err(Code::WRONG_INT));
        assert_eq!(call("F(int *)").results(Type::Int, 2), Err(Code::WRONG_COUNT));
        assert_eq!(call("F(int *,int *)").results(Type::Int, 1), Err(Code::WRONG_COUNT));
        assert_eq!(call("F()").end(), Ok(()));
    }

    #[test]
    fn numbers_are_written_as_c_does_with_13_digits() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (-12.5, "-12.5"),
            (0.1 + 0.2, "0.3"),
            (1.0 / 3.0, "0.3333333333333"),
            (0.0001, "0.0001"),
            (0.00001, "1e-05"),
            (123456789012.0, "123456789012"),
            (1e13, "1e+13"),
            (9.99999999999999, "10"),
            (-1.5e-9, "-1.5e-09"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
