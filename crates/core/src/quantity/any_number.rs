//! A number in JSON that may be infinite or NaN, which a broken device may report. JSON has no such numbers, so they are written
//! as text.

use serde::{Deserialize, Deserializer, Serializer};

/// Writes a finite number unchanged and any other number by its name.
///
/// # Errors
/// Errors of the serializer.
pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_finite() { serializer.serialize_f64(*value) } else { serializer.collect_str(value) }
}

/// Reads a number or the name of a number.
///
/// # Errors
/// The value is neither a number nor the name of one.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Either {
        Number(f64),
        Name(String),
    }
    match Either::deserialize(deserializer)? {
        Either::Number(value) => Ok(value),
        Either::Name(name) => name.parse().map_err(serde::de::Error::custom),
    }
}
