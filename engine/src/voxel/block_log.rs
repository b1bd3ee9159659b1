//! The block log: what an agent did, turn by turn.

use serde::de::{Error as _, SeqAccess, Visitor};
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::cell::Cell;
use super::palette::{MaterialId, Palette};

/// One action of an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A block was placed.
    Place {
        /// Where.
        cell: Cell,
        /// Of what, as an id in the log's palette.
        material: MaterialId,
    },
    /// The block at this cell was removed.
    Remove {
        /// Where.
        cell: Cell,
    },
}

/// As a row: `[x, y, z, material]` places, `[x, y, z]` removes.
impl Serialize for Event {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            Self::Place { cell: c, material } => (c.x, c.y, c.z, material).serialize(serializer),
            Self::Remove { cell: c } => (c.x, c.y, c.z).serialize(serializer),
        }
    }
}

impl Event {
    /// Where it happens.
    #[must_use]
    pub const fn cell(&self) -> Cell {
        match *self {
            Self::Place { cell, .. } | Self::Remove { cell } => cell,
        }
    }
}

/// The events that answered one instruction, in order.
pub type Turn = Vec<Event>;

/// Everything an agent did for one problem: ordered events over one or more turns, with the material names they use.
#[derive(Debug, Clone, Default)]
pub struct BlockLog {
    /// Material names of the events.
    pub palette: Palette,
    /// Events per turn.
    pub turns: Vec<Turn>,
}

impl BlockLog {
    /// Number of events over all turns.
    #[must_use]
    pub fn event_count(&self) -> usize {
        self.turns.iter().map(Vec::len).sum()
    }

    /// Adds a placement to the last turn.
    pub fn place(&mut self, cell: Cell, material: &str) {
        let material = self.palette.intern(material);
        if self.turns.is_empty() {
            self.turns.push(Turn::new());
        }
        if let Some(turn) = self.turns.last_mut() {
            turn.push(Event::Place { cell, material });
        }
    }

    /// Adds a removal to the last turn.
    pub fn remove(&mut self, cell: Cell) {
        if self.turns.is_empty() {
            self.turns.push(Turn::new());
        }
        if let Some(turn) = self.turns.last_mut() {
            turn.push(Event::Remove { cell });
        }
    }

    /// The turns as they are posted, in the compact form, with the log's palette in each.
    #[must_use]
    pub fn compact_turns(&self) -> serde_json::Value {
        let palette: Vec<&str> = self.palette.names().collect();
        self.turns.iter().map(|turn| serde_json::json!({ "palette": palette, "rows": turn })).collect()
    }

    /// The one canonical spelling of this log: compact JSON, from which its hash is taken and in which it is stored.
    ///
    /// Two logs with the same events in the same turns have the same bytes, whichever form they were posted in.
    #[must_use]
    pub fn canonical_json(&self) -> Vec<u8> {
        let mut used = Palette::new();
        for event in self.turns.iter().flatten() {
            if let Event::Place { material, .. } = event {
                used.intern(self.palette.name(*material));
            }
        }
        let renumbered: Vec<MaterialId> = self.palette.names().map(|name| used.get(name).unwrap_or(0)).collect();
        let canonical = Canonical { palette: &used, renumbered: &renumbered, turns: &self.turns };
        serde_json::to_vec(&canonical).unwrap_or_default()
    }

    /// Reads what [`BlockLog::canonical_json`] wrote.
    ///
    /// # Errors
    /// Where the text is anything else.
    pub fn from_canonical_json(text: &[u8]) -> Result<Self, serde_json::Error> {
        let stored: Stored = serde_json::from_slice(text)?;
        let mut palette = Palette::new();
        let ids: Vec<MaterialId> = stored.palette.iter().map(|name| palette.intern(name)).collect();
        let event = |StoredRow(cell, material): StoredRow| match material.map(|i| ids.get(i)) {
            None => Ok(Event::Remove { cell }),
            Some(Some(&material)) => Ok(Event::Place { cell, material }),
            Some(None) => Err(serde_json::Error::custom("a row names no entry of the palette")),
        };
        let turns = stored.turns.into_iter().map(|rows| rows.into_iter().map(event).collect());
        Ok(Self { turns: turns.collect::<Result<_, _>>()?, palette })
    }
}

#[derive(Deserialize)]
struct Stored {
    palette: Vec<String>,
    turns: Vec<Vec<StoredRow>>,
}

/// `[x, y, z]` or `[x, y, z, i]`.
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

struct Canonical<'a> {
    palette: &'a Palette,
    renumbered: &'a [MaterialId],
    turns: &'a [Turn],
}

impl Serialize for Canonical<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let names: Vec<&str> = self.palette.names().collect();
        let mut map = serializer.serialize_map(Some(2))?;
        map.serialize_entry("palette", &names)?;
        map.serialize_entry("turns", &Turns(self))?;
        map.end()
    }
}

struct Turns<'a>(&'a Canonical<'a>);

impl Serialize for Turns<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut seq = serializer.serialize_seq(Some(self.0.turns.len()))?;
        for turn in self.0.turns {
            seq.serialize_element(&Rows { turn, renumbered: self.0.renumbered })?;
        }
        seq.end()
    }
}

struct Rows<'a> {
    turn: &'a [Event],
    renumbered: &'a [MaterialId],
}

impl Serialize for Rows<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut seq = serializer.serialize_seq(Some(self.turn.len()))?;
        for event in self.turn {
            match *event {
                Event::Place { cell: c, material } => {
                    let id = self.renumbered.get(material as usize).copied().unwrap_or(0);
                    seq.serialize_element(&(c.x, c.y, c.z, id))?;
                }
                Event::Remove { cell: c } => seq.serialize_element(&(c.x, c.y, c.z))?,
            }
        }
        seq.end()
    }
}
