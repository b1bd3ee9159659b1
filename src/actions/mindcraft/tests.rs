//! The profile `mindcraft` in this process: forms of code, skills, time, and what is told.

use super::*;
use crate::actions::RecordedEvent;
use crate::actions::{ACTION_LIMITS, Profile};

fn replay(job: &Job) -> Answer {
    run(job, &ACTION_LIMITS, &PeakMemory::unknown(), Prepared::new(&ACTION_LIMITS).unwrap())
}

fn ran(code: &str) -> Replayed {
    let job = Job::of_code(Profile::Mindcraft, code.to_owned());
    replay(&job).turns.remove(0)
}

fn events(replayed: &Replayed) -> Vec<String> {
    let one = |event: &RecordedEvent| {
        let [x, y, z] = event.cell;
        let look = event.material.map_or("-", |index| &replayed.palette[index as usize]);
        format!("{look}@{x},{y},{z}")
    };
    replayed.events.iter().map(one).collect()
}

#[test]
fn every_form_of_code_is_run() {
    let place = "await skills.placeBlock(bot, 'stone', 1, 0, 0);";
    for code in [
        place.to_owned(),
        format!("(async (bot) => {{ {place} }})"),
        format!("// build\n(async (bot) => {{ {place} }});\n// done"),
        format!("async function build(bot) {{ {place} }}"),
        format!("async function build(bot) {{ {place} }}\nawait build(bot);\nreturn;"),
        format!("const w = 3;\n(async (bot) => {{ {place} }})"),
        format!("export default async function (bot) {{ {place} }}"),
        format!("export async function main(bot) {{ {place} }}"),
        format!("module.exports = async (bot) => {{ {place} }};"),
        format!("module.exports = {{ main: async (bot) => {{ {place} }} }};"),
        format!("({{ default: async (bot) => {{ {place} }} }})"),
        format!("const {{ Vec3 }} = require('vec3');\nconst p = new Vec3(1, 0, 0);\n{place}"),
        format!(
            "import {{ Vec3 }} from 'vec3';\nimport * as skills from '../../src/agent/library/skills.js';\n{place}"
        ),
        format!("Here you are:\n```javascript\n{place}\n```\nEnjoy!"),
        format!("for (let i = 0;\n i < 1;\n i++) {{\n{place}\n}}"),
    ] {
        let done = ran(&code);
        assert_eq!(done.error, None, "{code}: {done:?}");
        assert_eq!(events(&done), ["stone@1,0,0"], "{code}: {done:?}");
    }
}

#[test]
fn errors_keep_the_lines_of_the_answer_and_name_the_function() {
    let done = ran(
        "So:\n```js\nawait skills.placeBlock(bot, 'stone', 1, 0, 0);\nawait skills.goToPositon(bot, 1, 2, 3);\n```",
    );
    let error = done.error.clone().unwrap();
    assert_eq!(error.message, "TypeError: skills.goToPositon is not a function; did you mean goToPosition?");
    assert_eq!(error.line, Some(4));
    assert_eq!(events(&done), ["stone@1,0,0"]);
    let done = ran("try { skills.fillArea(bot); } catch (e) {}\nawait skills.placeBlock(bot, 'stone', 1, 0, 0);");
    assert!(done.error.is_none() && done.notes.iter().any(|note| note.contains("skills.fillArea")), "{done:?}");
    let done = ran("```js\nlet a = 1;\n```\nand then\n```js\nlet b = 2;\n```");
    assert!(done.unreadable && done.error.unwrap().message.starts_with("SyntaxError"));
}

#[test]
fn skills_do_what_a_bot_with_cheats_does() {
    let done = ran("await skills.placeBlock(bot, 'oak_door', 0, 0, 0);
         await skills.placeBlock(bot, 'bedrock', 5, 0, 0);
         await skills.placeBlock(bot, 'torch', 1, 1, 0, 'north');
         await skills.placeBlock(bot, 'oak_stairs', 2, 0, 0, 'south');
         await skills.placeBlock(bot, 'stone', new Vec3(1, 2, 3));
         log(bot, await skills.placeBlock(bot, 'no_such', 1, 2, 3));
         await skills.goToPosition(bot, 10, 0, 10);
         bot.chat('/setblock ~ ~ ~1 glass');
         log(bot, bot.entity.position);");
    assert_eq!(
        events(&done),
        [
            "oak_door@0,0,0",
            "oak_door[half=upper]@0,1,0",
            "bedrock@5,0,0",
            "wall_torch[facing=south]@1,1,0",
            "oak_stairs[facing=north]@2,0,0",
            "glass@10,0,11",
        ]
    );
    assert_eq!(done.error, None);
    assert!(done.log.contains(&"false".to_owned()) && done.log.contains(&"(10.5, 0, 10.5)".to_owned()), "{done:?}");
    assert!(done.dropped.iter().any(|dropped| dropped.reason.contains("NaN")), "{done:?}");
}

#[test]
fn files_of_a_turn_share_the_world_also_after_an_error() {
    let files =
        ["await skills.placeBlock(bot, 'sand', 0, 2, 0); nothing();", "await skills.breakBlockAt(bot, 0, 0, 0);"];
    let job = Job {
        profile: Profile::Mindcraft,
        start: None,
        turns: vec![
            TurnInput::Code(files.map(str::to_owned).to_vec()),
            TurnInput::Code(vec!["skills.stay(bot, -1)".to_owned()]),
        ],
    };
    let answer = replay(&job);
    assert_eq!(events(&answer.turns[0]), ["sand@0,2,0", "-@0,2,0", "sand@0,0,0", "-@0,0,0"]);
    let error = answer.turns[0].error.as_ref().unwrap();
    assert_eq!((error.file, error.line), (Some(1), Some(1)));
    assert!(answer.turns[1].notes.iter().any(|note| note.contains("never ends")), "{:?}", answer.turns[1]);
    assert!(answer.end.unwrap().standing().next().is_none());
}

#[test]
fn notes_say_which_file_they_are_about() {
    let files = ["1;".to_owned(), "2;".to_owned()];
    let turns = vec![TurnInput::Code(files.to_vec()), TurnInput::Code(files[..1].to_vec())];
    let answer = replay(&Job { profile: Profile::Mindcraft, start: None, turns });
    let idle = "the code ended without placing or removing a block";
    assert_eq!(answer.turns[0].notes, [format!("file 1: {idle}"), format!("file 2: {idle}")]);
    assert_eq!(answer.turns[1].notes, [idle]);
}

#[test]
fn time_is_virtual_and_ends() {
    let done = ran("await skills.wait(bot, 5000); log(bot, Date.now() >= 5000); setInterval(() => {}, 1000);");
    assert_eq!((done.error, done.log), (None, vec!["true".to_owned()]));
    assert!(done.notes.iter().any(|note| note.contains("were stopped")), "{:?}", done.notes);
    let done = ran("skills.placeBlock(bot, 'stone', 0, 0, 0); while (true) await skills.wait(bot, 3600000);");
    assert!(done.error.clone().unwrap().message.contains("virtual time"), "{done:?}");
    assert_eq!(events(&done), ["stone@0,0,0"]);
}

#[test]
fn the_documented_functions_are_those_that_code_finds() {
    use crate::actions::functions::functions_of;
    let documented = |object: &str| {
        let names = functions_of(Profile::Mindcraft).iter().filter_map(|function| {
            let (path, _) = function.call.split_once('(')?;
            path.strip_prefix(object)?.strip_prefix('.')
        });
        let mut names: Vec<&str> = names.collect();
        names.sort_unstable();
        names.dedup();
        names.concat()
    };
    let done = ran("for (const of of [skills, world]) log(bot, Object.keys(of).sort().join(''));");
    assert_eq!(done.log, [documented("skills"), documented("world")]);
    let found = ran(&format!(
        "log(bot, [{}].filter((name) => typeof bot[name] !== 'function').join());",
        ["chat", "placeBlock", "dig", "equip", "lookAt", "blockAt", "findBlock", "findBlocks", "waitForTicks"]
            .map(|name| format!("'{name}'"))
            .join(",")
    ));
    assert_eq!(found.log, [""]);
}
