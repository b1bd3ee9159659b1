//! Canonical JSON: it says the same as the JSON that it was made of, and is its own canonical form.

use plumbline_engine::hidden::canonical::canonical_json;
use serde_json::Value;

pub fn run(data: &[u8]) {
    let Ok(value) = serde_json::from_slice::<Value>(data) else { return };
    let canonical = canonical_json(&value);
    let again: Value = serde_json::from_slice(&canonical).expect("canonical JSON is JSON");
    assert!(is_same(&value, &again), "{value} became {again}");
    assert_eq!(canonical_json(&again), canonical);
}

/// Returns whether two values are equal; numbers count as ECMAScript has them.
fn is_same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Number(one), Value::Number(other)) => one.as_f64() == other.as_f64(),
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && one.iter().zip(other).all(|(one, other)| is_same(one, other))
        }
        (Value::Object(one), Value::Object(other)) => {
            one.len() == other.len()
                && one.iter().all(|(name, one)| other.get(name).is_some_and(|other| is_same(one, other)))
        }
        (one, other) => one == other,
    }
}
