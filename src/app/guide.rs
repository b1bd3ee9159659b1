//! The guide for agents: a system prompt that a lab can use as it stands.

use std::fmt::Write as _;

use crate::actions::Profile;
use crate::actions::functions::{Effect, KnownFunction, functions_of};
use crate::app::limits::LIMITS;
use plumbline_engine::voxel::blocks::GAME_VERSION;

/// A guide under one profile.
#[derive(Debug, Clone, Copy)]
pub struct Guide {
    /// What is true of the world, a sentence each.
    pub world: &'static [&'static str],
    /// What an answer must be, a sentence each.
    pub answer: &'static [&'static str],
    /// Functions that do something or tell something.
    functions: &'static [KnownFunction],
    /// Whether commands of the game do something.
    has_commands: bool,
    /// An answer as it should be.
    pub example: &'static str,
}

const WORLD: [&str; 3] = [
    "Coordinates are integers: x grows to the east, y upwards, z to the south.",
    "You stand at (0, 0, 0). The ground is flat: its uppermost blocks are at y = -1, and the first free layer is y = 0.",
    "Blocks have the ids of Minecraft Java Edition, such as oak_planks or stone_bricks.",
];

const PUBLISHED: Guide = Guide {
    world: &[
        WORLD[0],
        WORLD[1],
        WORLD[2],
        "A door or a bed is one block. Blocks need no support and never fall.",
        "You cannot see the world: every look finds air.",
        "What you break is gone in later turns only; breaking what you placed in the same turn has no effect.",
    ],
    answer: &[
        "Answer each instruction with one JavaScript code block that holds an async function with the parameter bot.",
        "Blocks of earlier turns still stand. Place only what is new, and break what must go.",
        "The order in which you place blocks counts: build from the ground up, part by part, without jumping around.",
        "No other names than those below exist. An unknown function ends the code; what was built before it counts.",
    ],
    functions: functions_of(Profile::Published),
    has_commands: false,
    example: "(async (bot) => {\n  for (let x = 0; x < 5; x++) {\n    for (let y = 0; y < 3; y++) {\n      \
              await skills.placeBlock(bot, 'stone_bricks', x, y, 2);\n    }\n  }\n})",
};

const MINDCRAFT: Guide = Guide {
    world: &[
        WORLD[0],
        WORLD[1],
        WORLD[2],
        "You play in creative mode with cheats on: you have every item, and reach is no limit.",
        "Placing a door makes both halves, and placing a bed its head and its foot. Torches and ladders need a block to \
         hold on to, and sand and gravel fall.",
        "The world answers: what you look at is what stands there.",
    ],
    answer: &[
        "Answer each instruction with one JavaScript code block. Its statements run as the body of an async function, so \
         await works everywhere.",
        "Blocks of earlier turns still stand. Place only what is new, and break what must go.",
        "The order in which you place blocks counts: build from the ground up, part by part, without jumping around.",
        "bot.chat runs commands of the game: /setblock, /fill, /clone.",
        "Skills take the names of blocks without `minecraft:` before them, even if a task allows the prefix.",
        "An unknown function ends the code; what was built before it counts.",
    ],
    functions: functions_of(Profile::Mindcraft),
    has_commands: true,
    example: "for (let x = 0; x < 5; x++) {\n  for (let y = 0; y < 3; y++) {\n    \
              await skills.placeBlock(bot, 'stone_bricks', x, y, 2);\n  }\n}\nbot.chat('/fill 0 3 2 4 3 2 oak_slab');",
};

impl Guide {
    /// Returns the guide for a profile.
    #[must_use]
    pub const fn of(profile: Profile) -> Self {
        match profile {
            Profile::Published => PUBLISHED,
            Profile::Mindcraft => MINDCRAFT,
        }
    }

    /// Returns the functions worth calling: those that act and those that look.
    pub fn functions(&self) -> impl Iterator<Item = &'static str> {
        let of_effect = |wanted: Effect| self.functions.iter().filter(move |known| known.effect == wanted);
        of_effect(Effect::Acts).chain(of_effect(Effect::Looks)).map(|known| known.call)
    }

    /// Returns the limits on an answer, a sentence each.
    #[must_use]
    pub fn limits(&self) -> Vec<String> {
        let mut limits = vec![
            format!(
                "Code has at most {} bytes a turn, and {} ms of processor time.",
                LIMITS.action_code_bytes, LIMITS.action_cpu_ms
            ),
            format!(
                "A build has at most {} events, and {} blocks stand at any time; {} for a task with a stress simulation that is graded at once.",
                LIMITS.events, LIMITS.blocks_with_stress, LIMITS.grade_blocks_with_stress
            ),
        ];
        if self.has_commands {
            limits.push(format!("One /fill or /clone changes at most {} blocks.", LIMITS.action_fill_blocks));
        }
        limits
    }

    /// Returns the guide as Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "You are a construction engineer in Minecraft {GAME_VERSION}. You get one instruction a turn, and you build \
             what it asks for by writing code.\n"
        );
        let limits = self.limits();
        let limits: Vec<&str> = limits.iter().map(String::as_str).collect();
        for (title, lines) in [("The world", self.world), ("Your answer", self.answer), ("Limits", &limits)] {
            let _ = write!(text, "\n## {title}\n\n");
            for line in lines {
                let _ = writeln!(text, "- {line}");
            }
        }
        text.push_str("\n## Functions\n\n");
        for call in self.functions() {
            let _ = writeln!(text, "- `{call}`");
        }
        let _ = write!(text, "\n## Example\n\n```javascript\n{}\n```\n", self.example);
        text
    }
}
