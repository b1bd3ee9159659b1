//! The JSON Schema of family files, with which editors complete and check them.

use serde_json::{Value, json};

use super::FamilyFile;
use crate::checks::Check;

/// Generates the schema from [`FamilyFile`] and the list of checks.
#[must_use]
pub fn json_schema() -> Value {
    let mut schema = schemars::schema_for!(FamilyFile).to_value();
    let known: Vec<Value> =
        Check::LIST.iter().map(|(name, what)| json!({ "const": name, "description": what })).collect();
    if let Some(name) = schema.pointer_mut("/$defs/CheckEntry/properties/fn") {
        let description = name["description"].take();
        *name = json!({ "description": description, "type": "string", "oneOf": known });
    }
    schema
}
