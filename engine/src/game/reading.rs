//! Commands as a player types them (`/setblock 0 0 0 stone`), read into what they ask for.

use super::command::{CloneFilter, CloneMode, Command, FillMode, SetMode, Step, View};
use super::refusal::Refusal;
use super::words::Words;

/// Greatest length of a command.
pub const MAX_CHARS: usize = 32_500;

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
    "gamemode",
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

impl Command {
    /// Reads a command without its leading slash.
    ///
    /// # Errors
    /// Returns a refusal if a vanilla server would not accept the command.
    pub fn read(text: &str) -> Result<Self, Refusal> {
        if text.len() > MAX_CHARS {
            return Err(Refusal::new(format!("more than {MAX_CHARS} characters")));
        }
        let mut words = Words { rest: Some(text) };
        let name = words.next("a command")?;
        match name {
            "setblock" => set_block(&mut words),
            "fill" => fill(&mut words),
            "clone" => clone(&mut words),
            "tp" | "teleport" => teleport(&mut words),
            "execute" => execute(&mut words),
            "gamerule" => Ok(game_rule(&mut words)),
            "summon"
                if words
                    .rest
                    .is_some_and(|rest| rest.trim_start_matches("minecraft:").starts_with("falling_block")) =>
            {
                Err(Refusal::new("summoned blocks are not simulated"))
            }
            "function" | "place" => {
                Err(Refusal::new("functions, features and structures of the game are not simulated"))
            }
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
    if is_coordinate(first) {
        let to = words.coordinates()?;
        words.end()?;
        return Ok(Command::Teleport { to, view: None });
    }
    let target = words.next("a target")?;
    // `NaN` and `undefined` are names of players to the server, and no such player is there.
    if !is_body(target) {
        return Err(Refusal::new(format!("no player was found for '{target}'")));
    }
    match words.rest {
        None => return Ok(Command::Harmless),
        Some(rest) if is_body(rest) => return Ok(Command::Harmless),
        Some(rest) if !is_coordinate(rest) => {
            return Err(Refusal::new(format!("no entity was found for '{rest}'")));
        }
        Some(_) => {}
    }
    let to = words.coordinates()?;
    let view = match words.rest {
        None => None,
        Some(rest) if rest.starts_with("facing ") => {
            words.next("facing")?;
            if words.rest.is_some_and(|rest| rest.starts_with("entity ")) {
                return Err(Refusal::new("facing an entity is not simulated"));
            }
            Some(View::Facing(words.coordinates()?))
        }
        Some(_) => Some(View::Angles(words.rotation()?)),
    };
    words.end()?;
    Ok(Command::Teleport { to, view })
}

/// Returns whether a target means the only body.
fn is_body(target: &str) -> bool {
    let begins = |selectors: &[&str]| selectors.iter().any(|selector| target.starts_with(selector));
    let is_player = target.contains("type=player") || target.contains("type=minecraft:player");
    target == "builder" || begins(&["@s", "@p", "@a"]) || begins(&["@e[", "@n["]) && is_player
}

/// `/execute` with the parts that keep the body and the world. Commands that it runs may be `/execute` again.
fn execute(words: &mut Words<'_>) -> Result<Command, Refusal> {
    let mut steps = Vec::new();
    loop {
        let name = words.next("'run'")?;
        match name {
            "as" => of_body(words)?,
            "at" => {
                of_body(words)?;
                steps.push(Step::AtBody);
            }
            "anchored" => steps.push(Step::Anchored {
                at_eyes: match words.next("an anchor")? {
                    "eyes" => true,
                    "feet" => false,
                    other => return Err(Refusal::new(format!("invalid entity anchor position '{other}'"))),
                },
            }),
            "in" => overworld(words.next("a dimension")?)?,
            "align" => {
                let axes = words.next("axes")?;
                let is_twice = |axis: char| axes.matches(axis).count() > 1;
                if axes.is_empty() || axes.chars().any(|axis| !"xyz".contains(axis) || is_twice(axis)) {
                    return Err(Refusal::new(format!(
                        "invalid swizzle '{axes}', expected a combination of x, y and z"
                    )));
                }
                steps.push(Step::Aligned(["x", "y", "z"].map(|axis| axes.contains(axis))));
            }
            "rotated" | "positioned" if words.rest.is_some_and(|rest| rest.starts_with("as ")) => {
                let is_position = name == "positioned";
                words.next("as")?;
                of_body(words)?;
                steps.push(if is_position { Step::PositionedAsBody } else { Step::RotatedAsBody });
            }
            "rotated" => steps.push(Step::Rotated(words.rotation()?)),
            "positioned" => steps.push(Step::Positioned(words.coordinates()?)),
            "run" if words.rest.is_some_and(|rest| rest.starts_with("execute ")) => {
                words.next("execute")?;
            }
            "run" => break,
            other => return Err(Refusal::new(format!("'/execute {other}' is not simulated"))),
        }
    }
    let rest = words.rest.take().ok_or_else(|| Refusal::new("incomplete command: a command is missing after 'run'"))?;
    let run = Command::read(rest)?;
    Ok(if steps.is_empty() { run } else { Command::From { steps, run: Box::new(run) } })
}

fn of_body(words: &mut Words<'_>) -> Result<(), Refusal> {
    let target = words.next("a target")?;
    if is_body(target) { Ok(()) } else { Err(Refusal::new(format!("no entity was found for '{target}'"))) }
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
    use crate::game::command::FillMode;
    use crate::game::registry::Look;

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
            "execute as @s at @s positioned 1 2 3 run execute align xz run setblock ~ ~ ~ stone",
            "tp @s 1 2 3 90 0",
            "tp @s 1 2 3 facing 4 5 6",
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
            ("tp Steve 1 2 3", "no player was found for 'Steve'"),
            ("tp @s 1 2 3 garbage", "expected a coordinate"),
            ("execute as Steve run say hi", "no entity was found"),
            ("execute anchored nose run say hi", "invalid entity anchor position 'nose'"),
            ("execute align xq run say hi", "invalid swizzle 'xq'"),
            ("fill 0 0 0 1 1 1 stone replace chest{Lock:\"x\"}", "block data in a filter is not simulated"),
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
