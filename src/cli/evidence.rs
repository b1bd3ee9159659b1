//! What the commands that verify are given: public keys, and receipts as they were handed out.

use serde_json::Value;

use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::evidence::GivenReceipt;

/// Parses a public key.
pub(super) fn key(text: &str) -> Result<String, &'static str> {
    let is_key = unhex::<32>(text.trim()).is_some();
    is_key.then(|| text.trim().to_ascii_lowercase()).ok_or("expected 64 hexadecimal digits")
}

/// Returns whether this is the reveal of an epoch, which other commands are given by mistake.
pub(super) fn is_reveal(value: &Value) -> bool {
    ["key", "specifications", "instances"].iter().all(|name| value.get(name).is_some())
}

/// Reads a receipt as the service returned it: alone, or inside the response to the step that it confirms.
pub(super) fn read_given(value: &Value) -> Option<GivenReceipt> {
    let inner = value.get("receipt").filter(|inner| inner.get("signature").is_some());
    serde_json::from_value(inner.unwrap_or(value).clone()).ok()
}
