//! Commands as a player types them (`/setblock 0 0 0 stone`), read into what they ask for.

use super::coordinates::Coordinates;
use super::registry::{Block, Look, StateId};

/// Why the server refused a command.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct Refusal {
    reason: String,
}

impl Refusal {
    /// Creates a refusal with its reason.
    pub fn new(reason: impl Into<String>) -> Self {
        Self { reason: reason.into() }
    }
}

/// A command that changes blocks or moves the body, or one that does neither.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// `/setblock POSITION BLOCK [destroy|keep|replace]`.
    SetBlock {
        /// Cell to set.
        at: Coordinates,
        /// Block to set.
        look: Look,
        /// What happens to the block that stands there.
        mode: SetMode,
    },
    /// `/fill FROM TO BLOCK [destroy|hollow|keep|outline|replace [FILTER]]`.
    Fill {
        /// Two opposite corners of the box.
        corners: [Coordinates; 2],
        /// Block to fill with.
        look: Look,
        /// Which cells of the box change.
        mode: FillMode,
    },
    /// `/clone FROM TO DESTINATION [replace|masked|filtered FILTER] [force|move|normal]`.
    Clone {
        /// Two opposite corners of the box.
        corners: [Coordinates; 2],
        /// Least corner of the copy.
        to: Coordinates,
        /// Which blocks are copied.
        which: CloneFilter,
        /// How the copy may lie to the original.
        mode: CloneMode,
    },
    /// `/tp [TARGET] POSITION`.
    Teleport {
        /// Position to go to.
        to: Coordinates,
    },
    /// `/gamerule commandModificationBlockLimit N`.
    BlockLimit {
        /// Greatest number of blocks that `/fill` and `/clone` may change.
        blocks: i32,
    },
    /// `/execute … positioned POSITION … run COMMAND`.
    At {
        /// Position at which the command is carried out.
        position: Coordinates,
        /// The command.
        run: Box<Self>,
    },
    /// A command that neither changes a block nor moves the body.
    Harmless,
}

/// Mode of `/setblock`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetMode {
    /// Takes the place of any other block.
    Replace,
    /// Breaks the old block first.
    Destroy,
    /// Only fills air.
    Keep,
}

/// Mode of `/fill`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FillMode {
    /// Changes all cells, or those that a filter accepts.
    Replace(Option<Filter>),
    /// Breaks the old blocks first.
    Destroy,
    /// Only fills air.
    Keep,
    /// Fills the outermost layer and empties the rest.
    Hollow,
    /// Fills the outermost layer only.
    Outline,
}

/// Which blocks `/clone` copies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CloneFilter {
    /// All, air too.
    All,
    /// All but air.
    Masked,
    /// Those that a filter accepts.
    Filtered(Filter),
}

/// How a copy may lie to its original.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CloneMode {
    /// They may not overlap.
    Normal,
    /// They may overlap.
    Force,
    /// They may overlap, and the original is removed.
    Move,
}

/// Blocks that a command is limited to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Filter {
    members: Members,
    wanted: Vec<(String, String)>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Members {
    Block(u16),
    Tag(&'static [&'static str]),
}

impl Filter {
    /// Returns whether the filter accepts a state.
    #[must_use]
    pub fn accepts(&self, state: StateId) -> bool {
        let block = state.block();
        let is_member = match self.members {
            Members::Block(number) => block.number == number,
            Members::Tag(patterns) => patterns.iter().any(|pattern| matches(pattern, block.name)),
        };
        is_member && self.wanted.iter().all(|(name, value)| state.get(name) == Some(value.as_str()))
    }
}

/// Matches a name with a pattern in which `*` at the beginning or the end stands for anything.
fn matches(pattern: &str, name: &str) -> bool {
    match (pattern.strip_prefix('*'), pattern.strip_suffix('*')) {
        (Some(end), _) => name.ends_with(end),
        (None, Some(begin)) => name.starts_with(begin),
        (None, None) => name == pattern,
    }
}

/// Block tags of the game whose members follow from their names.
const TAGS: &[(&str, &[&str])] = &[
    ("air", &["air", "cave_air", "void_air"]),
    ("anvil", &["anvil", "chipped_anvil", "damaged_anvil"]),
    ("banners", &["*_banner"]),
    ("beds", &["*_bed"]),
    ("buttons", &["*_button"]),
    ("candles", &["candle", "*_candle"]),
    ("concrete_powder", &["*_concrete_powder"]),
    (
        "dirt",
        &[
            "dirt",
            "grass_block",
            "podzol",
            "coarse_dirt",
            "mycelium",
            "rooted_dirt",
            "moss_block",
            "pale_moss_block",
            "mud",
            "muddy_mangrove_roots",
        ],
    ),
    ("doors", &["*_door"]),
    ("fence_gates", &["*_fence_gate"]),
    ("fences", &["*_fence"]),
    ("ice", &["ice", "packed_ice", "blue_ice", "frosted_ice"]),
    ("leaves", &["*_leaves"]),
    ("logs", &["*_log", "*_wood", "*_stem", "*_hyphae"]),
    ("planks", &["*_planks"]),
    ("pressure_plates", &["*_pressure_plate"]),
    ("rails", &["rail", "*_rail"]),
    ("sand", &["sand", "red_sand", "suspicious_sand"]),
    ("saplings", &["*_sapling", "azalea", "flowering_azalea", "mangrove_propagule"]),
    ("shulker_boxes", &["shulker_box", "*_shulker_box"]),
    ("signs", &["*_sign"]),
    ("slabs", &["*_slab"]),
    ("stairs", &["*_stairs"]),
    ("stone_bricks", &["stone_bricks", "mossy_stone_bricks", "cracked_stone_bricks", "chiseled_stone_bricks"]),
    ("terracotta", &["terracotta", "*_terracotta"]),
    ("trapdoors", &["*_trapdoor"]),
    ("walls", &["*_wall"]),
    ("wool", &["*_wool"]),
    ("wool_carpets", &["*_carpet"]),
];

/// Commands of the game that neither change a block nor move the body of the one who gives them.
const HARMLESS: &[&str] = &[
    "advancement",
    "attribute",
    "bossbar",
    "clear",
    "damage",
    "data",
    "defaultgamemode",
    "difficulty",
    "effect",
    "enchant",
    "experience",
    "fillbiome",
    "forceload",
    "function",
    "gamemode",
    "gamerule",
    "give",
    "help",
    "item",
    "kill",
    "list",
    "locate",
    "loot",
    "me",
    "msg",
    "particle",
    "playsound",
    "random",
    "recipe",
    "ride",
    "rotate",
    "say",
    "schedule",
    "scoreboard",
    "seed",
    "setworldspawn",
    "spawnpoint",
    "spectate",
    "spreadplayers",
    "stopsound",
    "summon",
    "tag",
    "team",
    "teammsg",
    "tell",
    "tellraw",
    "tick",
    "time",
    "title",
    "tm",
    "trigger",
    "w",
    "weather",
    "worldborder",
    "xp",
];

/// Name of a block, and the names and values of its properties.
type BlockText<'t> = (&'t str, Vec<(&'t str, &'t str)>);

/// The rest of a command's text, of which words are taken from the left.
struct Words<'t> {
    rest: Option<&'t str>,
}

impl<'t> Words<'t> {
    /// Takes the next word; words are parted by single spaces.
    fn next(&mut self, what: &str) -> Result<&'t str, Refusal> {
        let rest = self.rest.ok_or_else(|| Refusal::new(format!("incomplete command: {what} is missing")))?;
        let (word, rest) = rest.split_once(' ').map_or((rest, None), |(word, rest)| (word, Some(rest)));
        self.rest = rest;
        Ok(word)
    }

    fn coordinates(&mut self) -> Result<Coordinates, Refusal> {
        Coordinates::read([self.next("a coordinate")?, self.next("a coordinate")?, self.next("a coordinate")?])
    }

    /// Takes the name of a block with its properties, which may contain spaces, and skips its data.
    fn block_text(&mut self) -> Result<BlockText<'t>, Refusal> {
        let text = self.rest.ok_or_else(|| Refusal::new("incomplete command: a block is missing"))?;
        let end = text.find([' ', '[', '{']).unwrap_or(text.len());
        let (name, mut after) = text.split_at(end);
        let mut pairs: Vec<(&str, &str)> = Vec::new();
        if let Some(list) = after.strip_prefix('[') {
            let (list, rest) =
                list.split_once(']').ok_or_else(|| Refusal::new("expected closing ] for block state properties"))?;
            for pair in list.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
                let (name, value) = pair
                    .split_once('=')
                    .ok_or_else(|| Refusal::new(format!("expected value for property '{pair}'")))?;
                let (name, value) = (name.trim().trim_matches('"'), value.trim().trim_matches('"'));
                if pairs.iter().any(|(known, _)| *known == name) {
                    return Err(Refusal::new(format!("property '{name}' can only be set once")));
                }
                pairs.push((name, value));
            }
            after = rest;
        }
        if after.starts_with('{') {
            after = after_data(after)?;
        }
        self.rest = match after.strip_prefix(' ') {
            Some(rest) => Some(rest),
            None if after.is_empty() => None,
            None => return Err(Refusal::new(format!("expected a space before '{after}'"))),
        };
        Ok((name, pairs))
    }

    fn look(&mut self) -> Result<Look, Refusal> {
        let (name, pairs) = self.block_text()?;
        block_named(name)?.state(&pairs).map_err(|error| Refusal::new(error.to_string()))
    }

    fn filter(&mut self) -> Result<Filter, Refusal> {
        let (name, pairs) = self.block_text()?;
        let wanted = pairs.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        let members = if let Some(tag) = name.strip_prefix('#') {
            let bare = tag.strip_prefix("minecraft:").unwrap_or(tag);
            let known = TAGS.iter().find(|(known, _)| *known == bare);
            Members::Tag(known.ok_or_else(|| Refusal::new(format!("unknown block tag '{tag}'")))?.1)
        } else {
            let block = block_named(name)?;
            block.state(&pairs).map_err(|error| Refusal::new(error.to_string()))?;
            Members::Block(block.number)
        };
        Ok(Filter { members, wanted })
    }

    /// Checks that nothing is left, or takes one of the words that may follow.
    fn option(&mut self, known: &[&'static str]) -> Result<Option<&'static str>, Refusal> {
        if self.rest.is_none() {
            return Ok(None);
        }
        let word = self.next("a mode")?;
        let found = known.iter().find(|known| **known == word);
        found.map(|word| Some(*word)).ok_or_else(|| Refusal::new(format!("incorrect argument '{word}'")))
    }

    fn end(&self) -> Result<(), Refusal> {
        match self.rest {
            None => Ok(()),
            Some(rest) => Err(Refusal::new(format!("incorrect argument '{rest}'"))),
        }
    }
}

fn block_named(name: &str) -> Result<&'static Block, Refusal> {
    let bare = name.strip_prefix("minecraft:").or_else(|| name.strip_prefix(':')).unwrap_or(name);
    Block::named(bare).ok_or_else(|| Refusal::new(format!("unknown block type '{name}'")))
}

/// Skips block data in braces.
fn after_data(text: &str) -> Result<&str, Refusal> {
    let (mut depth, mut quote, mut is_escaped) = (0_usize, None, false);
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (Some(_), _) if is_escaped => is_escaped = false,
            (Some(_), '\\') => is_escaped = true,
            (Some(open), _) if c == open => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '{') => depth += 1,
            (None, '}') => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Ok(&text[at + c.len_utf8()..]);
        }
    }
    Err(Refusal::new("expected closing } for block data"))
}

impl Command {
    /// Reads a command without its leading slash.
    ///
    /// # Errors
    /// Returns a refusal if a vanilla server would not accept the command.
    pub fn read(text: &str) -> Result<Self, Refusal> {
        let mut words = Words { rest: Some(text) };
        let name = words.next("a command")?;
        match name {
            "setblock" => set_block(&mut words),
            "fill" => fill(&mut words),
            "clone" => clone(&mut words),
            "tp" | "teleport" => teleport(&mut words),
            "execute" => execute(&mut words),
            "gamerule" => Ok(game_rule(&mut words)),
            "place" => Err(Refusal::new("placing features and structures of the game is not simulated")),
            _ if HARMLESS.contains(&name) => Ok(Self::Harmless),
            _ => Err(Refusal::new(format!("unknown command '{name}'"))),
        }
    }
}

fn set_block(words: &mut Words<'_>) -> Result<Command, Refusal> {
    let (at, look) = (words.coordinates()?, words.look()?);
    let mode = match words.option(&["destroy", "keep", "replace"])? {
        Some("destroy") => SetMode::Destroy,
        Some("keep") => SetMode::Keep,
        _ => SetMode::Replace,
    };
    words.end()?;
    Ok(Command::SetBlock { at, look, mode })
}

fn fill(words: &mut Words<'_>) -> Result<Command, Refusal> {
    let corners = [words.coordinates()?, words.coordinates()?];
    let look = words.look()?;
    let mode = match words.option(&["destroy", "hollow", "keep", "outline", "replace"])? {
        Some("destroy") => FillMode::Destroy,
        Some("hollow") => FillMode::Hollow,
        Some("keep") => FillMode::Keep,
        Some("outline") => FillMode::Outline,
        Some("replace") if words.rest.is_some() => FillMode::Replace(Some(words.filter()?)),
        _ => FillMode::Replace(None),
    };
    words.end()?;
    Ok(Command::Fill { corners, look, mode })
}

fn clone(words: &mut Words<'_>) -> Result<Command, Refusal> {
    if words.rest.is_some_and(|rest| rest.starts_with("from ")) {
        words.next("from")?;
        overworld(words.next("a dimension")?)?;
    }
    let corners = [words.coordinates()?, words.coordinates()?];
    if words.rest.is_some_and(|rest| rest.starts_with("to ")) {
        words.next("to")?;
        overworld(words.next("a dimension")?)?;
    }
    let to = words.coordinates()?;
    let which = match words.option(&["replace", "masked", "filtered"])? {
        Some("masked") => CloneFilter::Masked,
        Some("filtered") => CloneFilter::Filtered(words.filter()?),
        _ => CloneFilter::All,
    };
    let mode = match words.option(&["force", "move", "normal"])? {
        Some("force") => CloneMode::Force,
        Some("move") => CloneMode::Move,
        _ => CloneMode::Normal,
    };
    words.end()?;
    Ok(Command::Clone { corners, to, which, mode })
}

fn overworld(name: &str) -> Result<(), Refusal> {
    match name {
        "overworld" | "minecraft:overworld" => Ok(()),
        _ => Err(Refusal::new(format!("only the overworld is simulated, not '{name}'"))),
    }
}

/// `/tp POSITION`, `/tp TARGET POSITION [YAW PITCH | facing …]`, or `/tp TARGET [OTHER]`, which leaves the only body where
/// it is.
fn teleport(words: &mut Words<'_>) -> Result<Command, Refusal> {
    let is_coordinate = |word: &str| word.starts_with(|c: char| c.is_ascii_digit() || "~^-.".contains(c));
    let first = words.rest.and_then(|rest| rest.split(' ').next()).unwrap_or_default();
    if first.is_empty() {
        return Err(Refusal::new("incomplete command: a position is missing"));
    }
    if !is_coordinate(first) {
        let target = words.next("a target")?;
        // `NaN` and `undefined` are names of players to the server, and no such player is there.
        if !target.starts_with('@') && words.rest.is_none_or(|rest| !is_coordinate(rest)) {
            return Err(Refusal::new(format!("no player was found for '{target}'")));
        }
        if words.rest.is_none_or(|rest| !is_coordinate(rest)) {
            return Ok(Command::Harmless);
        }
        // A rotation, or what the body faces, may follow.
        return Ok(Command::Teleport { to: words.coordinates()? });
    }
    let to = words.coordinates()?;
    words.end()?;
    Ok(Command::Teleport { to })
}

/// `/execute` with the parts that keep the body and the world: `as`, `at`, `in`, `align`, `anchored`, `rotated`, and with a
/// position.
fn execute(words: &mut Words<'_>) -> Result<Command, Refusal> {
    let mut position = None;
    loop {
        match words.next("'run'")? {
            "as" | "at" | "align" | "anchored" => drop(words.next("an argument")?),
            "in" => overworld(words.next("a dimension")?)?,
            "rotated" => drop((words.next("a rotation")?, words.next("a rotation")?)),
            "positioned" => position = Some(words.coordinates()?),
            "run" => break,
            other => return Err(Refusal::new(format!("'/execute {other}' is not simulated"))),
        }
    }
    let rest = words.rest.take().ok_or_else(|| Refusal::new("incomplete command: a command is missing after 'run'"))?;
    let run = Command::read(rest.strip_prefix('/').unwrap_or(rest))?;
    Ok(match position {
        Some(position) => Command::At { position, run: Box::new(run) },
        None => run,
    })
}

fn game_rule(words: &mut Words<'_>) -> Command {
    let limit = match (words.next("a rule"), words.next("a value")) {
        (Ok("commandModificationBlockLimit"), Ok(value)) => value.parse().ok(),
        _ => None,
    };
    limit.map_or(Command::Harmless, |blocks| Command::BlockLimit { blocks })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_as_a_server_reads_them() {
        for text in [
            "setblock 0 0 0 stone",
            "setblock ~ ~-1 ~ minecraft:oak_stairs[facing=east, half=top] keep",
            "setblock 0 0 0 chest{Items:[{id:\"a }\"}]} destroy",
            "fill 0 0 0 1 1 1 air replace #minecraft:logs[axis=x]",
            "fill 0 0 0 1 1 1 oak_door[half=upper] hollow",
            "clone 0 0 0 1 1 1 5 0 0 filtered stone move",
            "clone from overworld 0 0 0 1 1 1 to minecraft:overworld 5 0 0 masked",
            "tp 1 2 3",
            "tp @s 1 2 3",
            "teleport builder ~ ~5 ~",
            "execute as @s at @s positioned 1 2 3 run setblock ~ ~ ~ stone",
            "time set day",
            "gamerule commandModificationBlockLimit 100000",
        ] {
            assert!(Command::read(text).is_ok(), "{text}: {:?}", Command::read(text));
        }
        for (text, why) in [
            ("setblock NaN NaN NaN stone", "expected a coordinate instead of 'NaN'"),
            ("setblock 0 0 0", "a block is missing"),
            ("setblock 0 0  0 stone", "unknown block type '0'"),
            ("minecraft:setblock 0 0 0 stone", "unknown command"),
            ("tp 1 2 3 90 0", "incorrect argument '90 0'"),
            ("setblock 0 0 0 stonee", "unknown block type 'stonee'"),
            ("setblock 0 0 0 bedrock[part=head]", "does not have property 'part'"),
            ("setblock 0 0 0 oak_trapdoor[half=upper]", "does not accept 'upper'"),
            ("setblock 0 0 0 oak_stairs[half=top,half=top]", "can only be set once"),
            ("setblock 0 0 0 stone hollow", "incorrect argument 'hollow'"),
            ("setblock 0 0 0 stone ", "incorrect argument ''"),
            ("setblock 0 0 0 stone[", "expected closing ]"),
            ("setblock 0 0 0 #logs", "unknown block type"),
            ("fill 0 0 0 1 1 1 stone replace #minecraft:nothing", "unknown block tag"),
            ("clone 0 0 0 1 1 1 5 0 0 move", "incorrect argument 'move'"),
            ("tp NaN NaN NaN", "no player was found for 'NaN'"),
            ("fly 3", "unknown command 'fly'"),
            ("", "unknown command ''"),
        ] {
            let refusal = Command::read(text).unwrap_err().to_string();
            assert!(refusal.contains(why), "{text}: {refusal}");
        }
    }

    #[test]
    fn filters_know_blocks_tags_and_properties() {
        let accepts = |filter: &str, look: &str| {
            let text = format!("fill 0 0 0 1 1 1 air replace {filter}");
            let Ok(Command::Fill { mode: FillMode::Replace(Some(filter)), .. }) = Command::read(&text) else {
                panic!("{text}");
            };
            filter.accepts(Look::read(look).unwrap().state)
        };
        assert!(accepts("#logs", "oak_log") && accepts("#minecraft:logs", "stripped_oak_wood"));
        assert!(!accepts("#logs", "oak_planks") && !accepts("#doors", "oak_trapdoor"));
        assert!(accepts("oak_log", "oak_log[axis=x]") && !accepts("oak_log[axis=y]", "oak_log[axis=x]"));
    }
}
