//! Blocks and items of Minecraft 1.21.4, with the states of blocks and their numbers (`data/README.md`).

use std::collections::HashMap;
use std::fmt;
use std::sync::LazyLock;

/// Number of a block state, as the game numbers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StateId(pub u16);

/// State of air.
pub const AIR: StateId = StateId(0);

/// A property of a block, such as `facing`, with its values in the game's order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    /// Name of the property.
    pub name: &'static str,
    /// Possible values.
    pub values: Vec<&'static str>,
}

/// A kind of block.
#[derive(Debug, Clone)]
pub struct Block {
    /// Name without a namespace.
    pub name: &'static str,
    /// Position in the game's list of blocks.
    pub number: u16,
    /// Number of its first state.
    pub first: u16,
    /// State that it has unless another one is asked for.
    pub default: StateId,
    /// Time factor of breaking it; negative if it cannot be broken.
    pub hardness: f64,
    /// Its properties, in the game's order: the last one changes fastest.
    pub properties: Vec<Property>,
    /// Letters of the table for what the block is.
    flags: &'static str,
}

/// A block state that does not exist.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// The block does not exist.
    #[error("unknown block type '{0}'")]
    UnknownBlock(String),
    /// The block has no such property.
    #[error("block {block} does not have property '{property}'")]
    UnknownProperty {
        /// Name of the block.
        block: &'static str,
        /// Name of the property that was asked for.
        property: String,
    },
    /// The property has no such value.
    #[error("block {block} does not accept '{value}' for {property} property")]
    UnknownValue {
        /// Name of the block.
        block: &'static str,
        /// Name of the property.
        property: &'static str,
        /// Value that was asked for.
        value: String,
    },
}

struct Registry {
    blocks: Vec<Block>,
    by_name: HashMap<&'static str, u16, foldhash::fast::RandomState>,
    /// For each state, the number of its block.
    block_of: Vec<u16>,
    items: Vec<&'static str>,
    item_numbers: HashMap<&'static str, u16, foldhash::fast::RandomState>,
}

static REGISTRY: LazyLock<Registry> = LazyLock::new(|| {
    let mut blocks = Vec::with_capacity(1_100);
    let mut block_of = Vec::new();
    for (line, number) in include_str!("data/blocks.txt").lines().zip(0..) {
        let first = u16::try_from(block_of.len()).expect("the game has fewer than 65,536 states");
        let block = read_block(line, number, first).expect("the table is well-formed, as a test shows");
        block_of.extend(std::iter::repeat_n(number, block.state_count()));
        blocks.push(block);
    }
    let items: Vec<&str> = include_str!("data/items.txt").lines().collect();
    Registry {
        by_name: blocks.iter().map(|block| (block.name, block.number)).collect(),
        item_numbers: items.iter().copied().zip(0..).collect(),
        blocks,
        block_of,
        items,
    }
});

fn read_block(line: &'static str, number: u16, first: u16) -> Option<Block> {
    let mut columns = line.split(' ');
    let name = columns.next()?;
    let hardness = columns.next()?;
    let flags = columns.next()?;
    let (mut properties, mut default) = (Vec::new(), 0);
    for column in columns {
        let (name, values) = column.split_once('=')?;
        let chosen = values.split(',').position(|value| value.starts_with('*'))?;
        let values: Vec<&str> = values.split(',').map(|value| value.trim_start_matches('*')).collect();
        default = default * u16::try_from(values.len()).ok()? + u16::try_from(chosen).ok()?;
        properties.push(Property { name, values });
    }
    Some(Block {
        name,
        number,
        first,
        default: StateId(first + default),
        hardness: if hardness == "-" { -1.0 } else { hardness.parse().ok()? },
        properties,
        flags,
    })
}

impl Block {
    /// Returns the block of a name without a namespace.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        let registry = &*REGISTRY;
        registry.by_name.get(name).map(|number| &registry.blocks[usize::from(*number)])
    }

    /// Returns the block at a position of the game's list.
    #[must_use]
    pub fn numbered(number: u16) -> Option<&'static Self> {
        REGISTRY.blocks.get(usize::from(number))
    }

    /// Returns all blocks, in the game's order.
    #[must_use]
    pub fn all() -> &'static [Self] {
        &REGISTRY.blocks
    }

    /// Returns whether it has a collision box.
    #[must_use]
    pub fn is_solid(&self) -> bool {
        self.flags.contains('s')
    }

    /// Returns whether a player can break it.
    #[must_use]
    pub fn is_diggable(&self) -> bool {
        self.flags.contains('d')
    }

    /// Returns whether light passes through it.
    #[must_use]
    pub fn is_transparent(&self) -> bool {
        self.flags.contains('t')
    }

    /// Returns whether it drops an item when it is broken.
    #[must_use]
    pub fn has_drops(&self) -> bool {
        self.flags.contains('i')
    }

    /// Returns the number of states of the block.
    #[must_use]
    pub fn state_count(&self) -> usize {
        self.properties.iter().map(|property| property.values.len()).product()
    }

    /// Returns the position of a property in the block's list.
    #[must_use]
    pub fn property(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|property| property.name == name)
    }

    /// Returns the game's number of the state in which a property has a value, if both exist.
    #[must_use]
    pub fn with(&'static self, state: StateId, name: &str, value: &str) -> Option<StateId> {
        let at = self.property(name)?;
        let value = self.properties[at].values.iter().position(|known| *known == value)?;
        Some(self.with_index(state, at, value))
    }

    fn weight(&self, at: usize) -> usize {
        self.properties[at + 1..].iter().map(|property| property.values.len()).product()
    }

    fn index(&self, state: StateId, at: usize) -> usize {
        usize::from(state.0 - self.first) / self.weight(at) % self.properties[at].values.len()
    }

    fn with_index(&self, state: StateId, at: usize, value: usize) -> StateId {
        let (weight, old) = (self.weight(at), self.index(state, at));
        let offset = usize::from(state.0 - self.first) + value * weight - old * weight;
        StateId(self.first + u16::try_from(offset).expect("an offset within the states of the block"))
    }

    /// Finds the state in which the given properties have the given values, and all others their default.
    ///
    /// # Errors
    /// Returns an error that names the property or value that the block lacks.
    pub fn state(&'static self, wanted: &[(&str, &str)]) -> Result<Look, StateError> {
        let mut look = Look { state: self.default, named: 0 };
        for (property, value) in wanted {
            let Some(at) = self.property(property) else {
                return Err(StateError::UnknownProperty { block: self.name, property: (*property).to_owned() });
            };
            let known = &self.properties[at];
            let Some(index) = known.values.iter().position(|known| known == value) else {
                let value = (*value).to_owned();
                return Err(StateError::UnknownValue { block: self.name, property: known.name, value });
            };
            look = Look { state: self.with_index(look.state, at, index), named: look.named | 1 << at };
        }
        Ok(look)
    }
}

impl StateId {
    /// Returns the state of a number, if the game has one.
    #[must_use]
    pub fn numbered(number: u16) -> Option<Self> {
        (usize::from(number) < REGISTRY.block_of.len()).then_some(Self(number))
    }

    /// Returns the block of the state.
    #[must_use]
    pub fn block(self) -> &'static Block {
        let registry = &*REGISTRY;
        &registry.blocks[usize::from(registry.block_of[usize::from(self.0)])]
    }

    /// Returns the value of a property; none if the block lacks it.
    #[must_use]
    pub fn get(self, name: &str) -> Option<&'static str> {
        let block = self.block();
        let at = block.property(name)?;
        Some(block.properties[at].values[block.index(self, at)])
    }

    /// Returns whether this is a kind of air.
    #[must_use]
    pub fn is_air(self) -> bool {
        self == AIR || matches!(self.block().name, "cave_air" | "void_air")
    }
}

/// A block state as it was asked for: the state, and which of its properties were named. It prints as the block's name
/// with the named properties, such as `oak_door[half=upper]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Look {
    /// The state.
    pub state: StateId,
    /// A bit for each property of the block: whether it was named.
    pub named: u16,
}

impl Look {
    /// Air.
    pub const AIR: Self = Self { state: AIR, named: 0 };

    /// Returns the default state of a block.
    #[must_use]
    pub const fn of(block: &Block) -> Self {
        Self { state: block.default, named: 0 }
    }

    /// Reads a block with or without a namespace and properties, such as `minecraft:oak_door[half=upper]`.
    ///
    /// # Errors
    /// Returns an error if the block, a property or a value does not exist.
    pub fn read(text: &str) -> Result<Self, StateError> {
        let unknown = || StateError::UnknownBlock(text.to_owned());
        let (name, list) = match text.split_once('[') {
            Some((name, list)) => (name, list.strip_suffix(']').ok_or_else(unknown)?),
            None => (text, ""),
        };
        let block = Block::named(name.strip_prefix("minecraft:").unwrap_or(name)).ok_or_else(unknown)?;
        let pairs = list.split(',').filter(|pair| !pair.trim().is_empty());
        let wanted: Option<Vec<(&str, &str)>> =
            pairs.map(|pair| pair.split_once('=').map(|(name, value)| (name.trim(), value.trim()))).collect();
        block.state(&wanted.ok_or_else(unknown)?)
    }

    /// Returns the look with one property set and named; unchanged if the block lacks it.
    #[must_use]
    pub fn with(self, name: &str, value: &str) -> Self {
        let block = self.state.block();
        match (block.property(name), block.with(self.state, name, value)) {
            (Some(at), Some(state)) => Self { state, named: self.named | 1 << at },
            _ => self,
        }
    }
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let block = self.state.block();
        f.write_str(block.name)?;
        let mut named: Vec<(&str, &str)> = (0..block.properties.len())
            .filter(|at| self.named & 1 << at != 0)
            .map(|at| (block.properties[at].name, block.properties[at].values[block.index(self.state, at)]))
            .collect();
        named.sort_unstable();
        for (at, (name, value)) in named.iter().enumerate() {
            write!(f, "{}{name}={value}", if at == 0 { '[' } else { ',' })?;
        }
        if named.is_empty() { Ok(()) } else { f.write_str("]") }
    }
}

/// Returns all items, in the game's order.
#[must_use]
pub fn items() -> &'static [&'static str] {
    &REGISTRY.items
}

/// Returns the game's number of an item.
#[must_use]
pub fn item_number(name: &str) -> Option<u16> {
    REGISTRY.item_numbers.get(name).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_have_the_numbers_of_the_game() {
        // From the game's own report: `java -DbundlerMainClass=net.minecraft.data.Main -jar server.jar --reports`.
        let door = Block::named("oak_door").unwrap();
        assert_eq!((door.number, door.first, door.default.0, door.state_count()), (204, 4_677, 4_688, 64));
        let last = Block::all().last().unwrap();
        assert_eq!(usize::from(last.first) + last.state_count(), 27_866);
        assert_eq!(Block::all().len(), 1_095);
        assert_eq!(items().len(), 1_385);
        assert_eq!((AIR.block().name, AIR.is_air()), ("air", true));
    }

    #[test]
    fn a_look_prints_the_properties_that_were_named() {
        for (sent, printed) in [
            ("stone", "stone"),
            ("minecraft:oak_door[half=upper]", "oak_door[half=upper]"),
            ("oak_stairs[half=top, facing=north]", "oak_stairs[facing=north,half=top]"),
            ("oak_stairs[]", "oak_stairs"),
        ] {
            assert_eq!(Look::read(sent).unwrap().to_string(), printed);
        }
        assert_eq!(Look::read("oak_stairs[facing=north]").unwrap().state, Look::read("oak_stairs").unwrap().state);
        for sent in ["stonee", "bedrock[part=head]", "oak_trapdoor[half=upper]", "stone[", "stone[x]", "oak_door[half]"]
        {
            assert!(Look::read(sent).is_err(), "{sent}");
        }
    }

    #[test]
    fn every_state_can_be_taken_apart_and_put_together() {
        for block in Block::all() {
            for offset in 0..u16::try_from(block.state_count()).unwrap() {
                let state = StateId(block.first + offset);
                assert_eq!(state.block().name, block.name);
                let values: Vec<(&str, &str)> =
                    block.properties.iter().map(|p| (p.name, state.get(p.name).unwrap())).collect();
                assert_eq!(block.state(&values).unwrap().state, state);
            }
        }
    }
}
