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
fn json_in_a_fence_is_told_as_json_whatever_it_does_as_code() {
    for json in [r#"[{"action": "place", "x": 0}]"#, r#"{"events": []}"#] {
        let done = ran(&format!("Here's the list:\n```json\n{json}\n```"));
        assert!(done.notes.iter().any(|note| note == answer::JSON_IS_NO_CODE), "{json}: {done:?}");
    }
}

#[test]
fn what_models_often_write_and_mindcraft_does_otherwise_is_noted() {
    let noted = |code: &str, text: &str| {
        let done = ran(code);
        assert!(done.notes.iter().any(|note| note.contains(text)), "{code}: {done:?}");
        done
    };
    let both = "if (true)\n  await skills.placeBlock(bot, 'stone', 0, 0, 0);\nelse\n  await skills.placeBlock(bot, 'dirt', 1, 0, 0);";
    assert_eq!(events(&noted(both, "the else in line 3 belongs to that check")), ["stone@0,0,0", "dirt@1,0,0"]);
    for said in ["fill 0 0 0 4 4 0 stone", " /setblock 0 0 0 stone"] {
        let done = noted(&format!("bot.chat('{said}');"), "a command begins with /");
        assert!(done.events.is_empty());
    }
    let done = ran("await skills.placeBlock(bot, 'stoone', 0, 0, 0);");
    assert!(done.dropped[0].reason.starts_with("'stoone' is not the name of a block; did you mean stone"), "{done:?}");
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
        is_compared: false,
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
    let answer = replay(&Job { profile: Profile::Mindcraft, turns, ..Job::default() });
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
    let mut named: Vec<&str> = functions_of(Profile::Mindcraft)
        .iter()
        .flat_map(|function| function.call.split("bot.").skip(1))
        .filter_map(|rest| rest.split_once('(').map(|(name, _)| name))
        .filter(|name| !name.contains('.'))
        .collect();
    named.sort_unstable();
    named.dedup();
    let found = ran(
        "log(bot, Object.keys(bot).filter((name) => typeof bot[name] === 'function' && !name.startsWith('_')).sort().join());",
    );
    assert_eq!(found.log, [named.join(",")]);
}

#[test]
fn what_published_would_build_otherwise_is_told() {
    let differs = |code: &str| ran(code).notes.iter().any(|note| note.contains("published"));
    for (code, expected) in [
        ("await skills.placeBlock(bot, 'stone', 0, 0, 0);", false),
        ("await skills.placeBlock(bot, 'stone', 0, 0, 0); await skills.breakBlockAt(bot, 0, 0, 0);", true),
        // The block stands under both.
        ("for (const name of ['stone', 'air', 'dirt']) await skills.placeBlock(bot, name, 0, 0, 0);", false),
        ("bot.chat('/fill 0 0 0 2 0 0 stone');", true),
        ("bot.chat('hello');\nbot.chat('/fill 0 0 0 2 0 0 nothing_known');", false),
    ] {
        assert_eq!(differs(code), expected, "{code}");
    }
}

#[test]
fn tools_and_searches_without_effect_are_told() {
    let done = ran(
        "await skills.placeBlock(bot, 'stone', 0, 0, 0);\nawait skills.placeBlock(bot, 'stone', 0, 1, 0);\n\
                    const under = bot.blockAt(new Vec3(0, 0, 0));\nawait skills.useToolOnBlock(bot, 'water_bucket', under);\n\
                    await skills.useToolOnBlock(bot, 'bucket', under);\nawait skills.useToolOnBlock(bot, 'iron_hoe', under);\n\
                    await skills.useToolOnBlock(bot, 'flint_and_steel', under);\nworld.getNearestBlock(bot, 'gold_block', 300);",
    );
    assert_eq!(done.error, None);
    let reasons: Vec<&str> = done.dropped.iter().map(|dropped| dropped.reason.as_str()).collect();
    for part in ["nothing was poured", "bucket stayed empty", "a hoe tills only"] {
        assert!(reasons.iter().any(|reason| reason.contains(part)), "{part}: {reasons:?}");
    }
    for part in ["flint_and_steel is not simulated", "searches reach 128 blocks"] {
        assert!(done.notes.iter().any(|note| note.contains(part)), "{part}: {:?}", done.notes);
    }
}

#[test]
fn what_is_too_much_to_tell_is_counted() {
    let done = ran("for (let i = 0; i < 60; i++) try { bot['name' + i](); } catch {}");
    assert_eq!(done.notes.len(), MAX_NOTES + 1, "{:?}", done.notes);
    assert!(done.notes[MAX_NOTES].contains("left out"), "{:?}", done.notes);
    let done = ran("for (let i = 0; i < 30; i++) Promise.reject(new Error('no ' + i));");
    assert_eq!(done.more_errors.len() + 1, MAX_ERRORS);
    assert!(done.notes.iter().any(|note| note == "10 further errors left out"), "{:?}", done.notes);
}

#[test]
fn what_is_held_stays_in_the_hand_in_the_next_file_and_the_next_job() {
    let hold = "await skills.equip(bot, 'oak_planks');".to_owned();
    let place = "await bot.placeBlock(bot.blockAt(new Vec3(2, -1, 0)), new Vec3(0, 1, 0));".to_owned();
    let files = TurnInput::Code(vec![hold.clone(), place.clone()]);
    let mut both = replay(&Job { profile: Profile::Mindcraft, turns: vec![files], ..Job::default() });
    assert_eq!(events(&both.turns.remove(0)), ["oak_planks@2,0,0"]);
    let held = replay(&Job::of_code(Profile::Mindcraft, hold));
    let next = Job { start: held.end, ..Job::of_code(Profile::Mindcraft, place) };
    assert_eq!(events(&replay(&next).turns.remove(0)), ["oak_planks@2,0,0"]);
}

#[test]
fn what_cannot_be_dug_is_not_collected_and_the_code_goes_on() {
    let done = ran(
        "bot.chat('/setblock 2 0 0 bedrock');\nconst got = await skills.collectBlock(bot, 'bedrock', 2);\nlog(bot, got);\n\
         await skills.placeBlock(bot, 'stone', 1, 0, 0);",
    );
    assert_eq!((done.error.clone(), events(&done)), (None, vec!["bedrock@2,0,0".to_owned(), "stone@1,0,0".to_owned()]));
    assert_eq!(done.log.last().map(String::as_str), Some("false"), "{done:?}");
}

#[test]
fn an_error_tells_what_was_built_before_its_file_ended() {
    let place = |x: i32| format!("await skills.placeBlock(bot, 'stone', {x}, 0, 0);");
    let files = vec![place(0), format!("{}\nplaceBlock(bot, 'stone', 9, 0, 0);", place(1)), place(2)];
    let job = Job { profile: Profile::Mindcraft, turns: vec![TurnInput::Code(files)], ..Job::default() };
    let done = replay(&job).turns.remove(0);
    let error = done.error.clone().unwrap();
    assert_eq!((error.file, error.line, error.events, done.events.len()), (Some(2), Some(2), Some(2), 3));
    assert_eq!(error.message, "ReferenceError: placeBlock is not defined; did you mean skills.placeBlock?");
}

#[test]
fn a_function_that_builds_nothing_is_called_once() {
    for code in [
        "(async (bot) => { log(bot, 'hello'); })",
        "module.exports = async (bot) => { log(bot, 'hello'); };",
        "export default async (bot) => { log(bot, 'hello'); }",
        "async function main(bot) { log(bot, 'hello'); }",
        "log(bot, 'hello');",
    ] {
        let done = ran(code);
        assert_eq!((done.error.clone(), done.log.clone()), (None, vec!["hello".to_owned()]), "{code}: {done:?}");
    }
}

#[test]
fn what_mindcraft_takes_otherwise_is_told() {
    let done = ran("await skills.placeBlock(bot, 'minecraft:stone', 0, 0, 0);");
    assert!(done.dropped[0].reason.ends_with("skills take names without minecraft:"), "{done:?}");
    let place = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    let done = ran(&format!("```js\n{place}\n```\nand then\n```js\n{place}\n```"));
    assert!(
        done.unreadable && done.notes.iter().any(|note| note.contains("from the first code fence to the last")),
        "{done:?}"
    );
}
