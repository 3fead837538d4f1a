//! A number in JSON that may be none: JSON knows no infinity and no NaN, which a broken device may well say. They stand as text.

use serde::{Deserialize, Deserializer, Serializer};

/// Writes a finite number as it is, any other as its name.
///
/// # Errors
/// The serializer's.
pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_finite() { serializer.serialize_f64(*value) } else { serializer.collect_str(value) }
}

/// Reads either.
///
/// # Errors
/// What is neither a number nor the name of one.
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
