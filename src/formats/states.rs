//! Block states in files: names with properties, as text or as a compound.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::{FileError, FileResult};
use plumbline_engine::game::registry::Look;

/// Longest name of a block with its state, in bytes.
pub const MAX_NAME: usize = 1024;

/// Entry of a palette that is a list: a block with its state.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    #[serde(rename = "Name")]
    pub name: String,
    #[serde(rename = "Properties", default, skip_serializing_if = "BTreeMap::is_empty")]
    pub properties: BTreeMap<String, String>,
}

impl State {
    /// Air.
    pub fn air() -> Self {
        Self { name: "minecraft:air".to_owned(), properties: BTreeMap::new() }
    }

    /// Returns whether it is one of the game's kinds of air, or the block that stands for none.
    pub fn is_air(&self) -> bool {
        matches!(self.name.trim_start_matches("minecraft:"), "air" | "cave_air" | "void_air" | "structure_void")
    }

    /// Reads `name[property=value,…]`.
    pub fn read(text: &str) -> FileResult<Self> {
        let fault = || FileError::new(format!("{:?} is no block state", shown(text)));
        let (name, list) = match text.split_once('[') {
            Some((name, list)) => (name, list.strip_suffix(']').ok_or_else(fault)?),
            None => (text, ""),
        };
        let mut properties = BTreeMap::new();
        for pair in list.split(',').filter(|pair| !pair.is_empty()) {
            let (property, value) = pair.split_once('=').ok_or_else(fault)?;
            properties.insert(property.to_owned(), value.to_owned());
        }
        Ok(Self { name: name.to_owned(), properties })
    }

    /// Returns the block in the game's notation: without `minecraft:`, properties in order of their names.
    pub fn canonical(&self) -> FileResult<String> {
        let name = self.name.strip_prefix("minecraft:").unwrap_or(&self.name);
        let is_name = |text: &str| {
            let is_fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '_' | '.' | '-');
            !text.is_empty() && text.chars().all(is_fine)
        };
        let (space, path) = name.split_once(':').unwrap_or(("minecraft", name));
        let is_path = path.split('/').all(is_name);
        let are_pairs = self.properties.iter().all(|(property, value)| is_name(property) && is_name(value));
        if !is_name(space) || !is_path || !are_pairs || name.len() > MAX_NAME {
            return Err(FileError::new(format!("{:?} is no block state", shown(&self.text()))));
        }
        Ok(Self { name: name.to_owned(), properties: self.properties.clone() }.text())
    }

    /// Returns the state as a file holds it: with a namespace, and with all properties if the game has the block. A
    /// name that no file can hold becomes `plumbline:unnamed`.
    pub fn whole(block: &str) -> Self {
        let Ok(state) = Self::read(block).and_then(|state| Self::read(&state.canonical()?)) else {
            return Self { name: "plumbline:unnamed".to_owned(), properties: BTreeMap::new() };
        };
        let name = if state.name.contains(':') { state.name.clone() } else { format!("minecraft:{}", state.name) };
        let Ok(look) = Look::read(block) else { return Self { name, ..state } };
        let known = &look.state.block().properties;
        let value = |property: &str| look.state.get(property).unwrap_or_default().to_owned();
        Self { name, properties: known.iter().map(|known| (known.name.to_owned(), value(known.name))).collect() }
    }

    /// Returns `name[property=value,…]`.
    pub fn text(&self) -> String {
        let mut text = self.name.clone();
        for (at, (property, value)) in self.properties.iter().enumerate() {
            let _ = write!(text, "{}{property}={value}", if at == 0 { '[' } else { ',' });
        }
        if !self.properties.is_empty() {
            text.push(']');
        }
        text
    }
}

/// Returns the beginning of a text, for messages.
pub fn shown(text: &str) -> &str {
    &text[..text.floor_char_boundary(80)]
}
