//! Files that commands are given: their text, whatever wrote them, and their JSON.

use std::path::Path;

use anyhow::{Context as _, bail};
use serde::de::DeserializeOwned;
use serde_json::error::Category;
use serde_json::{Deserializer, Value};

/// Reads a file as text: UTF-8, with or without a byte order mark, or UTF-16 with one, as Windows PowerShell writes what
/// it redirects.
///
/// # Errors
/// Returns an error that names the file, if it cannot be read or is not text.
pub(super) fn text(path: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    if bytes.starts_with(&[0x1f, 0x8b]) {
        bail!("{} is compressed with gzip: unpack it first", path.display());
    }
    decoded(bytes).with_context(|| format!("{} is not text in UTF-8", path.display()))
}

/// Decodes what a file of text holds.
pub(super) fn decoded(bytes: Vec<u8>) -> anyhow::Result<String> {
    let units = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let (pairs, rest) = bytes.as_chunks::<2>();
        if !rest.is_empty() {
            bail!("it begins as UTF-16 and ends in the middle of a character");
        }
        let units: Vec<u16> = pairs.iter().map(|pair| unit(*pair)).collect();
        Ok(String::from_utf16(&units)?)
    };
    match bytes.as_slice() {
        [0xff, 0xfe, rest @ ..] => units(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => units(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(std::str::from_utf8(rest)?.to_owned()),
        _ => Ok(String::from_utf8(bytes)?),
    }
}

/// Reads a file of one JSON value.
///
/// # Errors
/// Returns an error that names the file and says what it holds instead.
pub(super) fn json<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let text = text(path)?;
    let value: Result<Value, _> = serde_json::from_str(&text);
    let value = value.map_err(|error| no_json(path, &text, &error))?;
    serde_json::from_value(value).with_context(|| path.display().to_string())
}

/// Reads a file of JSON values: one after the other, or in an array.
///
/// # Errors
/// Returns an error that names the file and says what it holds instead.
pub(super) fn values(path: &Path) -> anyhow::Result<Vec<Value>> {
    let text = text(path)?;
    if text.trim().is_empty() {
        bail!("{} is empty; it should hold JSON", path.display());
    }
    let values: Result<Vec<Value>, _> = Deserializer::from_str(&text).into_iter().collect();
    let values = values.map_err(|error| no_json(path, &text, &error))?;
    let each = values.into_iter().flat_map(|value| match value {
        Value::Array(items) => items,
        one => vec![one],
    });
    let values: Vec<Value> = each.collect();
    if values.is_empty() {
        bail!("{} holds an empty list", path.display());
    }
    Ok(values)
}

fn no_json(path: &Path, text: &str, error: &serde_json::Error) -> anyhow::Error {
    let file = path.display();
    match text.trim_start().chars().next() {
        None => anyhow::anyhow!("{file} is empty; it should hold JSON"),
        Some('<') => anyhow::anyhow!("{file} holds a page of HTML; it should hold JSON, as the API answers"),
        Some(_) if error.classify() == Category::Eof => anyhow::anyhow!(
            "{file} ends in the middle of its JSON (line {}, column {}): it was not saved whole",
            error.line(),
            error.column()
        ),
        Some(_) => anyhow::anyhow!("{file} is not JSON: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_whatever_wrote_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.json");
        let told = "{\"agent\": \"Mädi 🏠\"}\r\n";
        let wide: Vec<u16> = told.encode_utf16().collect();
        let with = |mark: &[u8], rest: Vec<u8>| [mark, &rest].concat();
        for bytes in [
            told.as_bytes().to_vec(),
            with(&[0xef, 0xbb, 0xbf], told.as_bytes().to_vec()),
            with(&[0xff, 0xfe], wide.iter().flat_map(|unit| unit.to_le_bytes()).collect()),
            with(&[0xfe, 0xff], wide.iter().flat_map(|unit| unit.to_be_bytes()).collect()),
        ] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(json::<Value>(&path).unwrap()["agent"], "Mädi 🏠");
            assert_eq!(values(&path).unwrap().len(), 1);
        }
        std::fs::write(&path, "{\"a\": 1}\n[{\"a\": 2}, {\"a\": 3}]\n").unwrap();
        assert_eq!(values(&path).unwrap().len(), 3);
        for (bytes, wanted) in [
            (b"".as_slice(), "is empty"),
            (b" \n", "is empty"),
            (b"<!doctype html>", "a page of HTML"),
            (b"{\"a\": [1, 2", "ends in the middle of its JSON (line 1, column 11)"),
            (b"{\"a\": x}", "is not JSON: expected value at line 1 column 7"),
            (b"\xff\xfea", "not text in UTF-8"),
            (b"\x80", "not text in UTF-8"),
            (b"\x1f\x8b\x08", "compressed with gzip"),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let told = json::<Value>(&path).unwrap_err().to_string();
            assert!(told.contains(wanted) && told.contains("f.json"), "{told}");
        }
    }
}
