//! Reads a line of NDJSON.

use super::{Reading, ReadingError};
use crate::dataset::table_error::start_of;
use serde::Deserialize;
use serde_json::Value;

/// Largest number of characters of a JSON error in a message, because the error quotes the line.
const REASON: usize = 120;
/// Missing number as written by Python, and as written in JSON.
const NAN: (&[u8], &[u8]) = (b"NaN", b"null");

#[derive(Deserialize)]
struct JsonReading {
    outputs: Vec<Option<f64>>,
    id: Option<Value>,
    t_s: Option<Value>,
}

/// Reads the line into the reading. The reading already has its line number.
pub(super) fn read(file: &str, line: &[u8], units: usize, reading: &mut Reading) -> Result<(), ReadingError> {
    let number = reading.line;
    let wrong = |column, reason| ReadingError::Json { file: file.to_owned(), line: number, column, reason };
    let text = line.trim_ascii_end();
    let object = object(text).or_else(|error| match with_null(text) {
        // a column counts in the original line
        Some((text, at)) => self::object(&text).map_err(|error| {
            let longer = NAN.1.len() - NAN.0.len();
            let end = |(nth, at): (usize, &usize)| at + nth * longer + NAN.1.len();
            let before = at.iter().enumerate().filter(|null| end(*null) <= error.column()).count();
            (error.column().saturating_sub(before * longer), error)
        }),
        None => Err((error.column(), error)),
    });
    let object = object.map_err(|(column, error)| {
        let words = error.to_string();
        let reason = words.rsplit_once(" at line ").map_or(words.as_str(), |(reason, _)| reason);
        wrong(column, start_of(reason, REASON))
    })?;
    for (key, value) in [("id", &object.id), ("t_s", &object.t_s)] {
        if !matches!(value, None | Some(Value::Number(_) | Value::String(_))) {
            return Err(wrong(1, format!("`{key}` must be a number or a text")));
        }
    }
    (reading.id, reading.t_s) = (object.id, object.t_s);
    let (found, expected) = (object.outputs.len(), units);
    if found != expected {
        return Err(ReadingError::Units { file: file.to_owned(), line: number, found, expected });
    }
    reading.outputs.clear();
    reading.outputs.extend(object.outputs.iter().map(|output| output.unwrap_or(f64::NAN)));
    Ok(())
}

fn object(text: &[u8]) -> Result<JsonReading, serde_json::Error> {
    match text.trim_ascii_start().starts_with(b"[") {
        true => serde_json::from_slice(text).map(|outputs| JsonReading { outputs, id: None, t_s: None }),
        false => serde_json::from_slice(text),
    }
}

/// Returns the text with `null` for each `NaN` outside of quotation marks, and the positions of the replaced words; `None` if
/// there is no `NaN`.
fn with_null(text: &[u8]) -> Option<(Vec<u8>, Vec<usize>)> {
    let (mut replaced, mut at) = (Vec::new(), Vec::new());
    let (mut is_quoted, mut is_escaped, mut index) = (false, false, 0);
    while let Some(&byte) = text.get(index) {
        if !is_quoted && text[index..].starts_with(NAN.0) {
            at.push(index);
            replaced.extend_from_slice(NAN.1);
            index += NAN.0.len();
            continue;
        }
        is_quoted ^= byte == b'"' && !is_escaped;
        is_escaped = is_quoted && byte == b'\\' && !is_escaped;
        replaced.push(byte);
        index += 1;
    }
    (!at.is_empty()).then_some((replaced, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outputs(text: &str) -> Result<Reading, String> {
        let mut reading = Reading { line: 1, ..Reading::default() };
        read("stdin", text.as_bytes(), 2, &mut reading).map(|()| reading).map_err(|error| error.to_string())
    }

    #[test]
    fn nan_as_python_writes_it_is_a_missing_channel() {
        for text in ["[NaN,1]", "[null,1]", " [ NaN , 1.0 ]", "{\"outputs\":[NaN,1],\"x\":[NaN,{\"NaN\":NaN}]}"] {
            let reading = outputs(text).unwrap();
            assert!(reading.outputs[0].is_nan() && reading.outputs[1] == 1.0, "{text}: {reading:?}");
        }
        let reading = outputs("{\"id\":\"NaN \\\" NaN\",\"t_s\":NaN,\"outputs\":[1,NaN]}").unwrap();
        assert_eq!((reading.id, reading.t_s), (Some(Value::from("NaN \" NaN")), None));
    }

    #[test]
    fn column_of_an_error_counts_in_the_original_line() {
        for (text, column) in [
            ("[NaN,x]", 6),
            ("[x,NaN]", 2),
            ("{\"outputs\":[NaN,NaN],\"y\":NaN,\"id\":NaN x}", 39),
            ("[nan,1]", 3),
            ("[NaN1,1]", 5),
            ("[\"NaN,1]", 8),
        ] {
            let words = outputs(text).unwrap_err();
            assert!(words.starts_with(&format!("stdin, line 1, column {column}: ")), "{text}: {words}");
        }
    }
}
