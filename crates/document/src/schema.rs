//! Creates JSON Schemas from lists of keys.

use super::key::{Absent, Bounds, Case, DefaultValue, Key, Keys, ValueKind};
use serde_json::{Map, Value as Json, json};

/// Returns the JSON Schema of a TOML text with these top-level keys. It is draft 7, which editors support. The schema refuses unknown
/// keys, missing keys, values of a wrong type, and values out of their bounds. It accepts more than the reader does. Only the
/// reader checks rules between keys, `nan`, and files that must exist.
pub fn schema(title: &str, keys: &Keys) -> Json {
    let mut root = table(keys);
    root.insert("$schema".to_owned(), json!("http://json-schema.org/draft-07/schema#"));
    root.insert("title".to_owned(), json!(title));
    Json::Object(root)
}

fn table(keys: &Keys) -> Map<String, Json> {
    let properties: Map<String, Json> = keys.all().map(|key| (key.name.to_owned(), property(key))).collect();
    let mut table = object(json!({ "type": "object", "additionalProperties": false, "properties": properties }));
    table.insert("required".to_owned(), json!(required(keys.always)));
    let cases: Vec<Json> = keys.cases.iter().map(|case| of_case(keys, case)).collect();
    if !cases.is_empty() {
        let rule = if keys.by.is_some() { "allOf" } else { "oneOf" };
        table.insert(rule.to_owned(), Json::Array(cases));
    }
    table
}

/// Returns which keys a table must have and mustn't have in one of its cases. With `by`, a word in the table chooses the case;
/// without it, the case is one of several.
fn of_case(keys: &Keys, case: &Case) -> Json {
    let foreign = keys.all().filter(|key| !keys.always.iter().chain(case.keys).any(|own| own.name == key.name));
    let foreign: Map<String, Json> = foreign.map(|key| (key.name.to_owned(), json!(false))).collect();
    let mut names = required(case.keys);
    match keys.by {
        Some(by) => json!({
            "if": { "properties": { by.name: { "const": case.name } }, "required": [by.name] },
            "then": { "required": names, "properties": foreign },
        }),
        None => {
            if !names.contains(&case.name) {
                names.push(case.name);
            }
            json!({ "required": names, "properties": foreign })
        }
    }
}

fn required(keys: &[Key]) -> Vec<&'static str> {
    keys.iter().filter(|key| key.absent == Absent::Refused).map(|key| key.name).collect()
}

fn property(key: &Key) -> Json {
    let mut property = object(kind(&key.kind));
    let description = match (key.example, key.kind.unit()) {
        ("", _) => key.meaning.to_owned(),
        (example, "") => format!("{}. Example: {example}", key.meaning),
        (example, unit) => format!("{}, {unit}. Example: {example}", key.meaning),
    };
    property.insert("description".to_owned(), json!(description));
    if let Some(default) = key.default() {
        property.insert("default".to_owned(), of_value(default));
    }
    Json::Object(property)
}

fn kind(kind: &ValueKind) -> Json {
    let list = |item: Json| json!({ "type": "array", "items": item });
    let pair = |item: Json| json!({ "type": "array", "items": item, "minItems": 2, "maxItems": 2 });
    let triple = |item: Json| json!({ "type": "array", "items": item, "minItems": 3, "maxItems": 3 });
    let whole = |min: u64, max: u64| json!({ "type": "integer", "minimum": min, "maximum": max });
    match kind {
        ValueKind::Number(bounds) => number(bounds),
        ValueKind::Range(bounds) => pair(number(bounds)),
        ValueKind::Numbers(bounds) => json!({ "anyOf": [number(bounds), list(number(bounds))] }),
        ValueKind::PerUnit(bounds) => list(number(bounds)),
        ValueKind::Places(bounds) => list(pair(number(bounds))),
        ValueKind::Matrix(bounds) => triple(triple(number(bounds))),
        ValueKind::Rows(bounds) => triple(list(number(bounds))),
        ValueKind::Whole(min, max) => whole(*min, *max),
        ValueKind::Wholes(min, max) => list(whole(*min, *max)),
        ValueKind::Flag => json!({ "type": "boolean" }),
        ValueKind::Text => json!({ "type": "string" }),
        ValueKind::Texts => list(json!({ "type": "string" })),
        ValueKind::Word(words) => json!({ "enum": words }),
        ValueKind::Words(words) => list(json!({ "enum": words })),
        ValueKind::Table(keys) => Json::Object(table(keys)),
        ValueKind::Tables(keys) => list(Json::Object(table(keys))),
        ValueKind::Either(kinds) => json!({ "anyOf": kinds.iter().map(self::kind).collect::<Vec<_>>() }),
    }
}

fn number(bounds: &Bounds) -> Json {
    let (least, most) = bounds.ends();
    let least_key = if bounds.admit(least) { "minimum" } else { "exclusiveMinimum" };
    json!({ "type": "number", least_key: least, "maximum": most })
}

fn of_value(value: DefaultValue) -> Json {
    match value {
        DefaultValue::Number(number) => json!(number),
        DefaultValue::Range(from, to) => json!([from, to]),
        DefaultValue::Whole(number) => json!(number),
        DefaultValue::Flag(flag) => json!(flag),
        DefaultValue::Word(word) => json!(word),
        DefaultValue::Texts(texts) => json!(texts),
    }
}

fn object(json: Json) -> Map<String, Json> {
    match json {
        Json::Object(object) => object,
        _ => Map::new(),
    }
}
