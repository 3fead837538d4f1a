//! Devices of the process protocol (docs/reference/process.md): one JSON object per line in, one per line out.
//!
//! They support the requests on that page and answer all others with an error. A request without an id gets its error under the
//! id `null`.

mod fault;
mod stage;
#[cfg(test)]
mod tests;

pub use fault::{ProcessStageFault, ProcessStageFaultAfterBytes, ProcessStageFaultKind};
pub use stage::{Printer, ProcessStageEmulator};

use super::Instrument;
use crate::scene::{Scene, SceneDevice};
use palpate_core::quantity::Axis;
use serde_json::{Map, Value, json};

/// Answer to a request, without its id, or an error text.
type ProcessReply = Result<Map<String, Value>, String>;

/// A load cell of the process protocol. Its readings are the scene's, in N. It has no range limit and no faults.
pub struct ProcessLoadCellEmulator;

/// An array of the process protocol. Its outputs are the scene's, in units of the reading for 1 N straight above one taxel.
pub struct ProcessArrayEmulator;

impl Instrument for ProcessLoadCellEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        take_line(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        reply(request, |request| match request.verb()? {
            "identify" => Ok(identity("load_cell")),
            "read" => Ok(object(json!({ "force_n": scene.load_cell_n(now_s) }))),
            verb => Err(unknown(verb)),
        })
    }
}

impl Instrument for ProcessArrayEmulator {
    fn device(&self) -> SceneDevice {
        SceneDevice::Array
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        take_line(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let units = scene.taxels();
        reply(request, |request| match request.verb()? {
            "identify" => {
                let mut answer = identity("array");
                answer.insert("units".into(), json!(units));
                Ok(answer)
            }
            "read" => {
                let mut outputs = vec![0.0; units];
                scene.outputs(now_s, &mut outputs);
                Ok(object(json!({ "outputs": outputs })))
            }
            verb => Err(unknown(verb)),
        })
    }
}

/// JSON request.
struct Request(Value);

impl Request {
    fn parse(line: &[u8]) -> Result<Request, String> {
        match serde_json::from_slice(line) {
            Ok(value @ Value::Object(_)) => Ok(Request(value)),
            Ok(_) => Err("a request is an object".into()),
            Err(error) => Err(format!("not JSON: {error}")),
        }
    }

    fn id(&self) -> Option<i64> {
        self.0.get("id")?.as_i64()
    }

    fn verb(&self) -> Result<&str, String> {
        self.0.get("do").and_then(Value::as_str).ok_or_else(|| "do is missing".into())
    }

    fn number(&self, key: &str) -> Result<f64, String> {
        self.0.get(key).and_then(Value::as_f64).ok_or_else(|| format!("{key} is not a number"))
    }

    fn word(&self, key: &str) -> Option<&str> {
        self.0.get(key).and_then(Value::as_str)
    }

    /// Numbers of some axes, by their names. `None` without the key.
    fn axes(&self, key: &str) -> Result<Option<[Option<f64>; 3]>, String> {
        if self.0.get(key).is_none() {
            return Ok(None);
        }
        let mut numbers = [None; 3];
        for (name, number) in self.object(key)? {
            let axis = Axis::ALL.into_iter().find(|axis| axis.name() == name);
            let axis = axis.ok_or_else(|| format!("there is no axis {name:?}"))?;
            let number = number.as_f64().ok_or_else(|| format!("the {key} of {name} is not a number"))?;
            numbers[axis.index()] = Some(number);
        }
        if numbers == [None; 3] { Err(format!("{key} names no axis")) } else { Ok(Some(numbers)) }
    }

    fn object(&self, key: &str) -> Result<&Map<String, Value>, String> {
        self.0.get(key).and_then(Value::as_object).ok_or_else(|| format!("{key} is not an object"))
    }
}

/// Takes the next line, if it isn't empty.
fn take_line(inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
    while let Some(end) = inbox.iter().position(|&byte| byte == b'\n') {
        let line: Vec<u8> = inbox.drain(..=end).collect();
        let line = line.trim_ascii();
        if !line.is_empty() {
            return Some(line.to_vec());
        }
    }
    None
}

/// Returns the line that answers a request, with the request's id.
fn reply(line: &[u8], act: impl FnOnce(&Request) -> ProcessReply) -> Vec<u8> {
    let request = Request::parse(line);
    let id = request.as_ref().ok().and_then(Request::id);
    let answer = match &request {
        Ok(request) if id.is_some() => act(request),
        Ok(_) => Err("the request has no id".into()),
        Err(error) => Err(error.clone()),
    };
    reply_line(id, answer)
}

fn reply_line(id: Option<i64>, answer: ProcessReply) -> Vec<u8> {
    let mut reply = object(json!({ "id": id }));
    reply.extend(answer.unwrap_or_else(|error| object(json!({ "error": error }))));
    (Value::Object(reply).to_string() + "\n").into_bytes()
}

fn identity(role: &str) -> Map<String, Value> {
    // the version of the documentation page
    let protocol = if role == "stage" { 2 } else { 1 };
    object(json!({ "role": role, "protocol": protocol, "identity": format!("emulated {role}, serial number 1") }))
}

fn unknown(verb: &str) -> String {
    format!("unknown request {verb:?}")
}

/// Returns the members of a `json!` value.
fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members,
        _ => Map::new(),
    }
}
