//! Moonraker's methods, over JSON-RPC and in the REST form (Moonraker's docs/external_api, components/application.py and
//! klippy_connection.py).

use super::commands::VERSION;
use super::http::{self, HttpRequest};
use super::klippy::Klippy;
use super::printer::{KlipperPrinter, Outcome, Ticket};
use super::status;
use crate::scene::Scene;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;

/// Paths of the REST form, their methods, and whether they may be read with GET and called with POST.
const ENDPOINTS: [(&str, &str, bool, bool); 9] = [
    ("/server/info", "server.info", true, false),
    ("/server/gcode_store", "server.gcode_store", true, false),
    ("/printer/info", "printer.info", true, true),
    ("/printer/objects/list", "printer.objects.list", true, true),
    ("/printer/objects/query", "printer.objects.query", true, true),
    ("/printer/gcode/script", "printer.gcode.script", true, true),
    ("/printer/emergency_stop", "printer.emergency_stop", false, true),
    ("/printer/restart", "printer.restart", false, true),
    ("/printer/firmware_restart", "printer.firmware_restart", false, true),
];

/// A request that is being answered.
pub(super) struct Exchange {
    form: Form,
    calls: VecDeque<RpcCall>,
    /// The call whose outcome is awaited, and its id.
    awaited: Option<(Option<Value>, Ticket)>,
    /// Answers so far.
    answers: Vec<String>,
    /// Status and reason of the HTTP answer.
    status: (i64, String),
    /// Whether the connection ends after the answer.
    pub closes: bool,
}

/// Form of the answer.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Rest,
    Rpc,
    /// JSON-RPC with a list of calls.
    Batch,
}

/// A call of a method.
enum RpcCall {
    /// A call with its id, method and parameters.
    Valid(Option<Value>, String, Map<String, Value>),
    /// What is none: an id, a code and a message.
    Invalid(Value, i64, &'static str),
}

impl Exchange {
    /// Begins to answer a request.
    pub(super) fn new(request: &HttpRequest<'_>) -> Self {
        let (calls, answers, awaited) = (VecDeque::new(), Vec::new(), None);
        let status = (200, "OK".to_owned());
        let mut exchange = Exchange { form: Form::Rpc, calls, awaited, answers, status, closes: request.closes };
        if request.path == "/server/jsonrpc" {
            match request.method {
                "POST" if request.json => exchange.read_rpc(request.body),
                "POST" => exchange.fail(400, "Bad Request"),
                _ => exchange.fail(405, "Method Not Allowed"),
            }
            return exchange;
        }
        exchange.form = Form::Rest;
        match ENDPOINTS.iter().find(|(path, ..)| *path == request.path) {
            None => exchange.fail(404, "Not Found"),
            Some((_, method, get, post)) => match request.method {
                "GET" if *get => exchange.read_rest(method, request),
                "POST" if *post => exchange.read_rest(method, request),
                _ => exchange.fail(405, "Method Not Allowed"),
            },
        }
        exchange
    }

    /// Carries out as much as possible. Returns the answer when it is complete.
    pub(super) fn go_on(&mut self, printer: &mut KlipperPrinter, scene: &mut Scene, now_s: f64) -> Option<Vec<u8>> {
        loop {
            if let Some((id, ticket)) = self.awaited.take() {
                match ticket.get() {
                    Some(outcome) => self.end_call(id, outcome.clone()),
                    None => {
                        self.awaited = Some((id, ticket));
                        return None;
                    }
                }
            }
            match self.calls.pop_front() {
                None => return Some(self.render(now_s)),
                Some(RpcCall::Invalid(id, code, message)) => self.answers.push(rpc_error(&id, code, message)),
                Some(RpcCall::Valid(id, method, params)) => {
                    self.awaited = Some((id, call(&method, &params, printer, scene, now_s)));
                    printer.run(scene, now_s);
                }
            }
        }
    }

    fn read_rpc(&mut self, body: &[u8]) {
        self.calls = match serde_json::from_slice(body) {
            Ok(Value::Array(calls)) => {
                self.form = Form::Batch;
                calls.into_iter().filter_map(read_call).collect()
            }
            Ok(one) => read_call(one).into_iter().collect(),
            Err(_) => [RpcCall::Invalid(Value::Null, -32700, "Parse error")].into(),
        };
    }

    fn read_rest(&mut self, method: &str, request: &HttpRequest<'_>) {
        let query = request.query.iter().cloned();
        let mut params: Map<String, Value> = if method == "printer.objects.query" {
            let wanted = |value: String| (!value.is_empty()).then(|| value.split(',').map(str::to_owned).collect());
            let objects: Map<_, _> = query.map(|(name, value)| (name, wanted(value).unwrap_or(Value::Null))).collect();
            [("objects".to_owned(), Value::Object(objects))].into_iter().collect()
        } else {
            query.map(|(name, value)| (name, Value::String(value))).collect()
        };
        if request.json
            && let Ok(Value::Object(body)) = serde_json::from_slice(request.body)
        {
            params.extend(body);
        }
        self.calls.push_back(RpcCall::Valid(Some(Value::Null), method.to_owned(), params));
    }

    fn end_call(&mut self, id: Option<Value>, outcome: Outcome) {
        match (self.form, outcome, id) {
            (Form::Rest, Ok(result), _) => self.answers.push(format!("{{\"result\":{result}}}")),
            (Form::Rest, Err((code, message)), _) => self.fail(code, &message),
            (_, Ok(result), Some(id)) => {
                self.answers.push(format!("{{\"jsonrpc\":\"2.0\",\"result\":{result},\"id\":{id}}}"));
            }
            (_, Ok(_), None) => {}
            (_, Err((code, message)), id) => {
                let code = if code == 404 { -32601 } else { code };
                self.answers.push(rpc_error(&id.unwrap_or_default(), code, &message));
            }
        }
    }

    /// Answers with an error of HTTP.
    fn fail(&mut self, code: i64, reason: &str) {
        self.status = (code, reason.to_owned());
        let (message, traceback) = (json!(reason), json!(format!("tornado.web.HTTPError: HTTP {code}: {reason}\n")));
        let body = format!("{{\"error\":{{\"code\":{code},\"message\":{message},\"traceback\":{traceback}}}}}");
        self.answers.push(body);
    }

    fn render(&self, now_s: f64) -> Vec<u8> {
        let body = self.answers.join(",");
        let body = if self.form == Form::Batch && !body.is_empty() { format!("[{body}]") } else { body };
        http::answer(self.status.0, &self.status.1, &body, self.closes, now_s)
    }
}

/// Reads a call. `None` if it is a response, which gets no answer.
fn read_call(call: Value) -> Option<RpcCall> {
    let id = call.get("id").cloned().filter(|id| !id.is_null());
    let invalid = |code, message| Some(RpcCall::Invalid(id.clone().unwrap_or_default(), code, message));
    if call.get("jsonrpc").and_then(Value::as_str) != Some("2.0") {
        return invalid(-32600, "Invalid Request");
    }
    let Some(method) = call.get("method")?.as_str() else { return invalid(-32600, "Invalid Request") };
    let known = ENDPOINTS.iter().any(|(_, known, ..)| *known == method);
    match call.get("params") {
        _ if !known => invalid(-32601, "Method not found"),
        None => Some(RpcCall::Valid(id, method.to_owned(), Map::new())),
        Some(Value::Object(params)) => Some(RpcCall::Valid(id, method.to_owned(), params.clone())),
        Some(_) => invalid(-32602, "Invalid params:"),
    }
}

fn rpc_error(id: &Value, code: i64, message: &str) -> String {
    let message = json!(message);
    format!("{{\"jsonrpc\":\"2.0\",\"error\":{{\"code\":{code},\"message\":{message}}},\"id\":{id}}}")
}

/// Carries out a call, or begins to.
fn call(
    method: &str,
    params: &Map<String, Value>,
    printer: &mut KlipperPrinter,
    scene: &mut Scene,
    now_s: f64,
) -> Ticket {
    let connected = !matches!(printer.klippy, Klippy::Disconnected(_));
    let outcome = match method {
        "server.info" => Ok(server_info(connected, printer.klippy.name())),
        "server.gcode_store" => {
            let count = params.get("count").and_then(|count| count.as_u64().or_else(|| count.as_str()?.parse().ok()));
            let skipped = count.map_or(0, |count| printer.store.len().saturating_sub(count as usize));
            let entry =
                |(time_s, kind, text): &(f64, &str, String)| json!({"message": text, "time": time_s, "type": kind});
            Ok(json!({"gcode_store": printer.store.iter().skip(skipped).map(entry).collect::<Vec<_>>()}))
        }
        _ if !connected => Err((503, "Klippy Host not connected".to_owned())),
        "printer.info" => Ok(printer_info(&printer.klippy)),
        "printer.objects.list" => Ok(json!({"objects": status::names(&printer.toolhead.board)})),
        "printer.objects.query" => match params.get("objects") {
            Some(Value::Object(objects)) => status::query(objects, printer, now_s),
            Some(_) => Err((400, "Invalid Argument Type [objects]".to_owned())),
            None => Err((400, "Missing Argument [objects]".to_owned())),
        },
        "printer.gcode.script" => match params.get("script") {
            Some(Value::String(script)) => {
                printer.note("command", script.clone(), now_s);
                return printer.begin(script, now_s);
            }
            Some(_) => Err((400, "Invalid Argument Type [script]".to_owned())),
            None => Err((400, "Missing Argument [script]".to_owned())),
        },
        "printer.emergency_stop" => {
            printer.shut_down("Shutdown due to webhooks request", scene, now_s);
            Ok("ok".into())
        }
        "printer.restart" => return printer.begin("RESTART", now_s),
        _ => return printer.begin("FIRMWARE_RESTART", now_s),
    };
    let ticket = Ticket::default();
    let _ = ticket.set(outcome);
    ticket
}

fn server_info(connected: bool, state: &str) -> Value {
    json!({
        "klippy_connected": connected,
        "klippy_state": state,
        "components": ["klippy_connection", "application", "jsonrpc", "klippy_apis", "data_store", "authorization"],
        "failed_components": [],
        "registered_directories": ["config", "logs"],
        "warnings": [],
        "websocket_count": 0,
        "moonraker_version": "v0.8.0",
        "missing_klippy_requirements": ["virtual_sdcard", "display_status", "pause_resume"],
        "api_version": [1, 4, 0],
        "api_version_string": "1.4.0",
    })
}

fn printer_info(klippy: &Klippy) -> Value {
    json!({
        "state": klippy.name(),
        "state_message": klippy.message(),
        "hostname": "printer",
        "klipper_path": "/home/pi/klipper",
        "python_path": "/home/pi/klippy-env/bin/python",
        "process_id": 1275,
        "user_id": 1000,
        "group_id": 1000,
        "log_file": "/home/pi/printer_data/logs/klippy.log",
        "config_file": "/home/pi/printer_data/config/printer.cfg",
        "software_version": VERSION,
        "cpu_info": "4 core ?",
    })
}
