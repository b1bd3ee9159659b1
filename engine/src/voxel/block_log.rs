//! The block log: the actions of an agent, turn by turn.

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::cell::Cell;
use super::palette::{MaterialId, Palette};
use super::profile::Profile;

/// One action of an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The agent placed a block.
    Place {
        /// Cell of the block.
        cell: Cell,
        /// Material of the block, as an id in the log's palette.
        material: MaterialId,
    },
    /// The agent removed a block.
    Remove {
        /// Cell of the block.
        cell: Cell,
    },
}

/// Serialises the event as a row: `[x, y, z, material]` for a placement, `[x, y, z]` for a removal.
impl Serialize for Event {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Place { cell: c, material } => (c.x, c.y, c.z, material).serialize(serializer),
            Self::Remove { cell: c } => (c.x, c.y, c.z).serialize(serializer),
        }
    }
}

impl Event {
    /// Returns the cell where the event happens.
    #[must_use]
    pub const fn cell(&self) -> Cell {
        match *self {
            Self::Place { cell, .. } | Self::Remove { cell } => cell,
        }
    }
}

/// The events of an agent's answer to one instruction, in order.
pub type Turn = Vec<Event>;

/// All actions of an agent on one problem: ordered events over one or more turns, with the material names they use.
#[derive(Debug, Clone, Default)]
pub struct BlockLog {
    /// Material names of the events.
    pub palette: Palette,
    /// Events of each turn.
    pub turns: Vec<Turn>,
    /// Rules under which the events become a build.
    pub profile: Profile,
}

impl BlockLog {
    /// Returns the number of events over all turns.
    #[must_use]
    pub fn event_count(&self) -> usize {
        self.turns.iter().map(Vec::len).sum()
    }

    /// Appends a placement to the last turn, and starts the first turn if there is none.
    pub fn place(&mut self, cell: Cell, material: &str) {
        let material = self.palette.intern(material);
        if self.turns.is_empty() {
            self.turns.push(Turn::new());
        }
        if let Some(turn) = self.turns.last_mut() {
            turn.push(Event::Place { cell, material });
        }
    }

    /// Appends a removal to the last turn, and starts the first turn if there is none.
    pub fn remove(&mut self, cell: Cell) {
        if self.turns.is_empty() {
            self.turns.push(Turn::new());
        }
        if let Some(turn) = self.turns.last_mut() {
            turn.push(Event::Remove { cell });
        }
    }

    /// Returns the turns in the compact form in which clients post them, each with the whole palette of the log.
    #[must_use]
    pub fn compact_turns(&self) -> serde_json::Value {
        let palette: Vec<&str> = self.palette.names().collect();
        self.turns.iter().map(|turn| serde_json::json!({ "palette": palette, "rows": turn })).collect()
    }

    /// Returns the canonical form of this log: compact JSON, which is stored and from which the hash is computed.
    ///
    /// Two logs with the same events in the same turns yield the same bytes, whichever form they were posted in.
    #[must_use]
    pub fn canonical_json(&self) -> Vec<u8> {
        let mut used = Palette::new();
        let mut renumbered: Vec<Option<MaterialId>> = vec![None; self.palette.len()];
        for event in self.turns.iter().flatten() {
            if let Event::Place { material, .. } = event
                && let Some(number @ None) = renumbered.get_mut(*material as usize)
            {
                *number = Some(used.intern(self.palette.name(*material)));
            }
        }
        let mut json = Vec::with_capacity(64 + 16 * self.event_count());
        json.extend_from_slice(b"{\"palette\":");
        let names: Vec<&str> = used.names().collect();
        serde_json::to_writer(&mut json, &names).expect("names are JSON, and memory takes it");
        json.extend_from_slice(b",\"turns\":[");
        for (i, turn) in self.turns.iter().enumerate() {
            json.extend_from_slice(if i == 0 { b"[" } else { b",[" });
            write_rows(&mut json, turn, &renumbered);
            json.push(b']');
        }
        json.push(b']');
        if !self.profile.is_published() {
            json.extend_from_slice(b",\"profile\":");
            serde_json::to_writer(&mut json, &self.profile).expect("a name is JSON, and memory takes it");
        }
        json.push(b'}');
        json
    }

    /// Parses a log from the JSON that [`BlockLog::canonical_json`] writes.
    ///
    /// # Errors
    /// Returns an error if the text does not have that form.
    pub fn from_canonical_json(text: &[u8]) -> Result<Self, serde_json::Error> {
        let stored: Stored = serde_json::from_slice(text)?;
        let mut palette = Palette::new();
        let ids: Vec<MaterialId> = stored.palette.iter().map(|name| palette.intern(name)).collect();
        let event = |StoredRow(cell, material): StoredRow| match material.map(|i| ids.get(i)) {
            None => Ok(Event::Remove { cell }),
            Some(Some(&material)) => Ok(Event::Place { cell, material }),
            Some(None) => Err(serde_json::Error::custom("a row refers to a material that is not in the palette")),
        };
        let turns = stored.turns.into_iter().map(|rows| rows.into_iter().map(event).collect());
        Ok(Self { turns: turns.collect::<Result<_, _>>()?, palette, profile: stored.profile })
    }
}

#[derive(Deserialize)]
struct Stored {
    palette: Vec<String>,
    turns: Vec<Vec<StoredRow>>,
    #[serde(default)]
    profile: Profile,
}

/// A stored row: `[x, y, z]` for a removal, `[x, y, z, i]` to place palette entry `i`.
struct StoredRow(Cell, Option<usize>);

impl<'de> Deserialize<'de> for StoredRow {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Row;
        impl<'de> Visitor<'de> for Row {
            type Value = StoredRow;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("[x, y, z] or [x, y, z, i]")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut row: A) -> Result<StoredRow, A::Error> {
                let mut next = || row.next_element::<i32>()?.ok_or_else(|| A::Error::custom("a row is too short"));
                let cell = Cell::new(next()?, next()?, next()?);
                Ok(StoredRow(cell, row.next_element()?))
            }
        }
        deserializer.deserialize_seq(Row)
    }
}

/// Writes the rows of a turn, with the numbers that their materials have in the stored palette.
fn write_rows(json: &mut Vec<u8>, turn: &[Event], renumbered: &[Option<MaterialId>]) {
    for (i, event) in turn.iter().enumerate() {
        let mut row = RowText::default();
        if i > 0 {
            row.push(b',');
        }
        let Cell { x, y, z } = event.cell();
        for (before, number) in [(b'[', x), (b',', y), (b',', z)] {
            row.push(before);
            row.push_number(number);
        }
        if let Event::Place { material, .. } = event {
            row.push(b',');
            row.push_number(renumbered.get(*material as usize).copied().flatten().unwrap_or(0));
        }
        row.push(b']');
        json.extend_from_slice(&row.bytes[..row.length]);
    }
}

/// The text of a row, which is put together before it is appended: a log has many rows, and a vector makes sure of its
/// room at each byte.
struct RowText {
    /// A row has at most three coordinates of 11 bytes, a material of 10, and 6 bytes about them.
    bytes: [u8; 3 * 11 + 10 + 6],
    length: usize,
}

impl Default for RowText {
    fn default() -> Self {
        Self { bytes: [0; _], length: 0 }
    }
}

impl RowText {
    fn push(&mut self, byte: u8) {
        self.bytes[self.length] = byte;
        self.length += 1;
    }

    /// Appends an integer. Most integers of a log have one digit or two.
    fn push_number(&mut self, number: impl itoa::Integer + TryInto<u8> + Copy) {
        match number.try_into() {
            Ok(digit @ 0..=9) => self.push(b'0' + digit),
            Ok(two @ 10..=99) => {
                self.push(b'0' + two / 10);
                self.push(b'0' + two % 10);
            }
            _ => itoa::Buffer::new().format(number).bytes().for_each(|byte| self.push(byte)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_written_as_serde_writes_them() {
        const NUMBERS: [i32; 12] = [0, 9, 10, 99, 100, 255, 256, 1_000, -1, -10, i32::MAX, i32::MIN];
        let mut log = BlockLog::default();
        for (i, x) in NUMBERS.into_iter().enumerate() {
            for z in NUMBERS {
                log.place(Cell::new(x, -x.saturating_neg(), z), &format!("material {i}"));
                log.remove(Cell::new(z, i32::MIN, x));
            }
        }
        let told: serde_json::Value = serde_json::from_slice(&log.canonical_json()).unwrap();
        assert_eq!(told["turns"][0], serde_json::to_value(&log.turns[0]).unwrap());
        let read = BlockLog::from_canonical_json(&log.canonical_json()).unwrap();
        assert_eq!(read.turns, log.turns);
    }
}
