//! Canonical JSON (RFC 8785), which is hashed and signed: equal values always give the same bytes.

use serde::Serialize;
use sha2::{Digest as _, Sha256};

/// A SHA-256 hash.
pub type Hash = [u8; 32];

/// Returns the canonical JSON of a value (RFC 8785). Every value that this module hashes has string keys and finite
/// numbers, so serialization cannot fail.
#[must_use]
pub fn canonical_json<T: Serialize>(value: &T) -> Vec<u8> {
    serde_json_canonicalizer::to_vec(value).expect("what is hashed and signed is JSON, with finite numbers")
}

/// Returns the SHA-256 of a value's canonical JSON.
#[must_use]
pub fn hash_of<T: Serialize>(value: &T) -> Hash {
    Sha256::digest(canonical_json(value)).into()
}

/// Decodes lower-case or upper-case hexadecimal; returns `None` for any other text or length.
#[must_use]
pub fn unhex<const N: usize>(text: &str) -> Option<[u8; N]> {
    if text.len() != 2 * N || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let mut bytes = [0; N];
    for (i, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok()?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::hex;
    use serde_json::json;

    /// Keys are sorted by their UTF-16 code units, and numbers are written as in ECMAScript: the example of RFC 8785,
    /// section 3.2.
    #[test]
    fn json_is_canonical() {
        let value: serde_json::Value = serde_json::from_str(
            r#"{"numbers":[333333333.33333329,1E30,4.50,2e-3],"literals":[null,true,false],"b":1}"#,
        )
        .unwrap();
        let text = String::from_utf8(canonical_json(&value)).unwrap();
        assert_eq!(text, r#"{"b":1,"literals":[null,true,false],"numbers":[333333333.3333333,1e+30,4.5,0.002]}"#);
        assert_eq!(canonical_json(&json!({ "b": 1, "a": 2 })), br#"{"a":2,"b":1}"#);
    }

    #[test]
    fn hexadecimal_reads_back() {
        assert_eq!(unhex::<3>(&hex(&[0, 171, 255])), Some([0, 171, 255]));
        assert!(unhex::<2>("abc").is_none() && unhex::<2>("zzzz").is_none() && unhex::<2>("é\u{e9}").is_none());
    }
}
