//! What labs rely on: how the command ends and what it says, and which profile counts where none is named.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

use crate::support::{PROGRAM, Service};

fn replay(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(PROGRAM).arg("replay").args(arguments).current_dir(folder).output().unwrap()
}

fn lines(output: &Output) -> Vec<Value> {
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn the_command_ends_as_documented() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("first.js", "await skills.placeBlock(bot, 'oak_log', 0, 0, 0);\n");
    write("second.md", "Now a door:\n```js\nawait skills.placeBlock(bot, 'oak_door', 2, 0, 0);\n```\n");
    write("third.js", "\r\n\tawait skills.breakBlockAt(bot, 0, 0, 0);\r\n\tawait skills.goTo(bot);\r\n");
    write("no.js", "if (");
    write("prose.md", "I cannot do this.");
    write("empty.js", "");
    let mindcraft = |rest: &[&str]| replay(folder.path(), &[&["--profile", "mindcraft"], rest].concat());
    let block = |x: i32, y: i32, block: &str| json!({ "x": x, "y": y, "z": 0, "block": block });
    let door = [block(2, 0, "oak_door"), block(2, 1, "oak_door[half=upper]")];

    // Files in order, and a second turn in the same world.
    let all = mindcraft(&["--structure", "first.js", "second.md", "--turn", "third.js"]);
    assert_eq!(all.status.code(), Some(3), "{all:?}");
    assert_eq!(
        lines(&all),
        door,
        "the log was removed in the second turn, and what stands is printed in spite of the error"
    );
    let told = String::from_utf8_lossy(&all.stderr);
    assert!(told.contains("third.js: line 3: TypeError: skills.goTo is not a function"), "{told}");
    let good = mindcraft(&["first.js", "--turn", "second.md"]);
    assert_eq!(good.status.code(), Some(0), "{good:?}");
    let placed =
        |x: i32, y: i32, material: &str| json!({ "action": "place", "x": x, "y": y, "z": 0, "material": material });
    assert_eq!(lines(&good), [placed(0, 0, "oak_log"), placed(2, 0, "oak_door"), placed(2, 1, "oak_door")]);
    // Where nothing can be read, nothing ran.
    for unreadable in ["no.js", "prose.md"] {
        let ended = mindcraft(&[unreadable]);
        assert_eq!((ended.status.code(), lines(&ended).len()), (Some(1), 0), "{ended:?}");
        assert!(!ended.stderr.is_empty());
    }
    // One that can be read is enough.
    let some = mindcraft(&["--structure", "no.js", "--turn", "second.md"]);
    assert_eq!((some.status.code(), lines(&some)), (Some(3), door.to_vec()), "{some:?}");
    // A file that is not there is no script error.
    let missing = mindcraft(&["first.js", "nosuch.js"]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("nosuch.js"), "{missing:?}");
}

/// Code that is posted to the newest suite without a profile is what a bot in the game would have done.
#[tokio::test]
async fn code_for_the_newest_suite_counts_as_in_the_game() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let new = json!({ "agent": "coder", "suite": "mineceraft-lite@4" });
    let run = service.post_json("/v1/runs", &new).await.json()["id"].as_str().unwrap().to_owned();
    let tasks = service.get("/v1/tasks?suite=mineceraft-lite@4&limit=1").await.json();
    let task = tasks["tasks"][0]["number"].clone();
    let code = "So:\n```js\nbot.chat('/fill 0 0 0 1 0 0 stone');\n```";
    let turns = tasks["tasks"][0]["turns"].as_array().map_or(1, Vec::len);
    let turns: Vec<Value> = (0..turns).map(|_| json!({ "action_code": code })).collect();
    let posted = service.post_json("/v1/submissions", &json!({ "run": run, "task": task, "turns": turns })).await;
    assert_eq!(posted.status, 202, "{}", posted.text);
    let path = format!("/v1/submissions/{}", posted.json()["id"].as_str().unwrap());
    let graded = service.wait_for(&path, |one| one["state"] == "graded").await;
    assert_eq!(graded["profile"], "mindcraft");
    assert_eq!(service.get(&format!("{path}/report")).await.json()["profile"], "mindcraft");
    let finished = service.post_json(&format!("/v1/runs/{run}/finish"), &json!({ "skip": "unanswered" })).await;
    assert!(finished.status.is_success(), "{}", finished.text);
    assert_eq!(service.get(&format!("/v1/runs/{run}")).await.json()["profile"], "mindcraft");
    service.wait_for(&format!("/v1/runs/{run}"), |run| run["state"] == "finished").await;
    let board = service.get("/v1/leaderboards/mineceraft-lite").await.json();
    assert_eq!(board["rows"][0]["profile"], "mindcraft", "{board}");
    let csv = service.get("/v1/leaderboards/mineceraft-lite?format=csv").await.text;
    assert!(csv.lines().nth(1).is_some_and(|row| row.contains("mindcraft")), "{csv}");
}

#[test]
fn what_published_would_have_built_otherwise_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let told = |code: &str| {
        std::fs::write(folder.path().join("a.js"), code).unwrap();
        let done = replay(folder.path(), &["--profile", "mindcraft", "a.js"]);
        String::from_utf8(done.stderr).unwrap()
    };
    let place = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    let wrapped = |code: &str| format!("(async (bot) => {{ {code} }})");
    let marker = "under published another build would stand after this turn";
    assert!(!told(&wrapped(place)).contains(marker), "both place one block");
    for (code, cells) in [
        // No main function, which `published` does not call.
        (place.to_owned(), "1 cell differs"),
        // The second half of a door.
        (wrapped("await skills.placeBlock(bot, 'oak_door', 0, 0, 0);"), "1 cell differs"),
        // Commands, which `published` does not know.
        (wrapped("bot.chat('/fill 0 0 0 2 0 0 stone');"), "3 cells differ"),
        // A look at what stands.
        (
            wrapped(&format!(
                "{place} if (bot.blockAt(new Vec3(0, 0, 0)).name === 'stone') await skills.placeBlock(bot, 'dirt', 1, 0, 0);"
            )),
            "1 cell differs",
        ),
        // Sand that falls.
        (wrapped("await skills.placeBlock(bot, 'sand', 0, 3, 0);"), "2 cells differ"),
        // A name that the game does not have.
        (wrapped("await skills.placeBlock(bot, 'unobtainium', 0, 0, 0);"), "1 cell differs"),
    ] {
        let found = told(&code);
        assert!(found.contains(&format!("{marker}: {cells}")), "{code}: {found}");
    }
    assert!(told(place).contains("published takes a function, such as `async (bot) => { … }`"), "{}", told(place));
}

/// Containers may not find out whether a process has one thread, which is asked before it forks.
#[test]
fn where_processes_may_not_fork_code_runs_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("good.js"), "await skills.placeBlock(bot, 'stone', 0, 0, 0);").unwrap();
    std::fs::write(folder.path().join("endless.js"), "while (true) {}").unwrap();
    let refused = |file: &str| {
        let mut command = Command::new("strace");
        command.args([
            "-f",
            "-qq",
            "-o",
            "/dev/null",
            "-e",
            "trace=unshare",
            "-e",
            "inject=unshare:error=EPERM",
            PROGRAM,
        ]);
        command.args(["replay", "--profile", "mindcraft", "--structure", file]).current_dir(folder.path());
        command.output().expect("tests/run installs strace")
    };
    for _ in 0..4 {
        let good = refused("good.js");
        assert_eq!((good.status.code(), lines(&good).len()), (Some(0), 1), "{good:?}");
    }
    let endless = refused("endless.js");
    assert_eq!(endless.status.code(), Some(3), "{endless:?}");
}
