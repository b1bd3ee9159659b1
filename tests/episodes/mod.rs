//! Episodes over HTTP: an attempt at a task, turn by turn, in a world that the service keeps.

mod limits;

use std::path::Path;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use crate::support::database::pool;
use crate::support::epoch::{Scene, id};
use crate::support::{Answer, PROGRAM, Service};
use plumbline::store::db::{query, query_scalar};
use plumbline_engine::tasks::{Task, embedded};
use reqwest::StatusCode;
use serde_json::{Value, json};

fn start(folder: &Path) -> Service {
    Service::start(&folder.join("p.db"), &["--workers", "2"])
}

/// Opens an episode and returns its path.
async fn open(service: &Service, body: &Value) -> String {
    let opened = service.post_json("/v1/episodes", body).await;
    assert_eq!(opened.status, StatusCode::CREATED, "{}", opened.text);
    opened.headers["location"].to_str().unwrap().to_owned()
}

async fn step(service: &Service, episode: &str, body: &Value) -> Answer {
    service.post_json(&format!("{episode}/steps"), body).await
}

fn task_of_turns(turns: usize) -> Task {
    let suite = embedded::latest().unwrap();
    suite.tasks.iter().find(|task| task.turns.len() == turns).unwrap().clone()
}

/// An answer as a model writes it: prose around a fence, many lines, tabs, another script.
const FIRST: &str = "Ich baue zuerst den Boden.\n\n```javascript\n// 床\nfor (let x = 0; x < 3; x++) {\n\t\
                     await skills.placeBlock(bot, 'stone', x, 0, 0);\n}\nlog(bot, `fertig: ${3}`);\n```\nDanach die Tür.";
const SECOND: &str = "await skills.placeBlock(bot, 'oak_door', 0, 1, 0);\n\
                      await skills.breakBlockAt(bot, 2, 0, 0);\nskills.fly(bot);";

#[tokio::test]
async fn an_episode_is_graded_as_the_same_code_posted_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let task = task_of_turns(2);
    let run = service.begin_run("stepper", "mineceraft").await;
    let episode = open(&service, &json!({ "task": task.id, "run": run })).await;
    let first = service.get(&episode).await.json();
    assert_eq!((&first["turn"], &first["turns"], &first["state"]), (&json!(1), &json!(2), &json!("open")));
    assert_eq!((&first["prompt"], &first["task"]), (&json!(task.turns[0].prompt), &json!(task.id)));
    assert!(first["world"]["ground"].as_str().unwrap().contains("y = -1"), "{first}");
    let before = service.http.get(format!("{}{episode}/picture", service.url)).send().await.unwrap();
    assert_eq!(before.headers()["content-type"], "image/png");
    let before = before.bytes().await.unwrap();

    let view = json!({ "from": [0, -1, 0], "to": [2, 2, 0] });
    let asked = json!({ "step": 1, "action_code": FIRST, "view": view, "picture": "north-west" });
    let done = step(&service, &episode, &asked).await.json();
    assert_eq!(done["events"].as_array().unwrap().len(), 3, "{done}");
    assert_eq!((&done["blocks"], &done["code"]["log"]), (&json!(3), &json!(["fertig: 3"])));
    assert_eq!(done["view"]["palette"], json!(["grass_block", "stone"]), "{done}");
    assert_eq!(done["view"]["rows"].as_array().unwrap().len(), 6);
    let file = service.http.get(format!("{}{episode}/picture?from=north-west", service.url)).send().await.unwrap();
    let file = BASE64_STANDARD.encode(file.bytes().await.unwrap());
    assert_eq!(done["picture"], json!(file), "the picture is that of its own route");
    let wrong = step(&service, &episode, &json!({ "events": [], "picture": "above" })).await;
    assert!(wrong.text.contains("south-east") && wrong.text.contains("/picture"), "{}", wrong.text);
    // An error of the code is no error of the request, and what was built before it stands.
    let done = step(&service, &episode, &json!({ "step": 2, "action_code": SECOND })).await.json();
    assert!(done["code"]["error"]["message"].as_str().unwrap().contains("skills.fly"), "{done}");
    assert_eq!(done["blocks"], 4);
    let seen = service.get(&format!("{episode}/view?from=0,2,0&to=0,1,0")).await.json();
    assert_eq!(seen["palette"], json!(["oak_door", "oak_door[half=upper]"]), "{seen}");
    let after = service.http.get(format!("{}{episode}/picture?from=north-west", service.url)).send().await.unwrap();
    let after = after.bytes().await.unwrap();
    assert!(after.starts_with(b"\x89PNG\r\n") && after != before);

    let next = service.post_json(&format!("{episode}/next-turn"), &json!({ "step": 3 })).await.json();
    assert_eq!((&next["turn"], &next["prompt"], &next["blocks"]), (&json!(2), &json!(task.turns[1].prompt), &json!(4)));
    let events = json!([{ "action": "remove", "x": 0, "y": 0, "z": 0 },
                        { "action": "place", "x": 7, "y": 0, "z": 0, "material": "stone" }]);
    let done = step(&service, &episode, &json!({ "events": events })).await.json();
    assert_eq!((&done["step"], &done["turn"], &done["code"]), (&json!(4), &json!(2), &Value::Null), "{done}");
    // Code sees what the events did.
    let code = "log(bot, world.getBlockAtPosition(bot, 7, 0, 0).name, world.getBlockAtPosition(bot, 0, 0, 0).name);";
    let done = step(&service, &episode, &json!({ "action_code": code })).await.json();
    assert_eq!(done["code"]["log"], json!(["stone air"]), "{done}");

    let submitted = service.post_json(&format!("{episode}/submit"), &Value::Null).await;
    assert_eq!(submitted.status, StatusCode::ACCEPTED, "{}", submitted.text);
    let path = format!("/v1/submissions/{}", submitted.json()["submission"].as_str().unwrap());
    let graded = service.wait_for(&path, |submission| submission["state"] == "graded").await;
    assert_eq!((&graded["profile"], &graded["run"]), (&json!("mindcraft"), &json!(run)));
    // What the code of all steps told is kept with the submission.
    let told = graded["action_code"].as_array().unwrap_or_else(|| panic!("{graded}"));
    assert_eq!(told.iter().map(|turn| turn["turn"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2], "{graded}");
    assert_eq!(told[1]["log"], json!(["stone air"]), "{graded}");
    let turns = json!([{ "action_code": [FIRST, SECOND] }, { "events": events }]);
    let at_once = json!({ "task": task.id, "profile": "mindcraft", "turns": turns });
    let at_once = service.post_json("/v1/grade", &at_once).await.json();
    assert_eq!(graded["log_hash"], at_once["log_hash"]);
    let finished = service.post_json(&format!("/v1/runs/{run}/finish"), &json!({ "skip": "unanswered" })).await;
    assert!(finished.status.is_success(), "{}", finished.text);
    let late = service.post_json("/v1/episodes", &json!({ "task": task.id, "run": run })).await;
    assert!(late.status == StatusCode::CONFLICT && late.text.contains("run-closed"), "{}", late.text);
    // It is over, and submitting again gives the same submission.
    let again = service.post_json(&format!("{episode}/submit"), &json!({})).await;
    assert_eq!(again.json(), submitted.json());
    assert_eq!(service.get(&episode).await.json()["state"], "submitted");
    let late = step(&service, &episode, &json!({ "action_code": "1" })).await;
    assert!(late.text.contains("episode-over"), "{}", late.text);
}

#[tokio::test]
async fn a_repeated_step_is_made_once_and_a_faulty_one_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let episode = open(&service, &json!({ "task": task_of_turns(1).id })).await;
    let place = |x: i32| format!("await skills.placeBlock(bot, 'stone', {x}, 0, 0);");
    let first = json!({ "step": 1, "action_code": place(0) });
    let made = step(&service, &episode, &first).await;
    assert_eq!(step(&service, &episode, &first).await.text, made.text);
    let other = step(&service, &episode, &json!({ "step": 1, "action_code": place(1) })).await;
    assert_eq!(other.status, StatusCode::CONFLICT, "{}", other.text);
    assert!(other.text.contains("the next step of this episode is 2"), "{}", other.text);
    // The same request twice at the same time is one step; of two different ones, one is made.
    let same = json!({ "step": 2, "action_code": place(2) });
    let (one, two) = tokio::join!(step(&service, &episode, &same), step(&service, &episode, &same));
    assert_eq!((one.status, &one.text), (StatusCode::OK, &two.text));
    let both = (json!({ "step": 3, "action_code": place(3) }), json!({ "step": 3, "action_code": place(4) }));
    let both = tokio::join!(step(&service, &episode, &both.0), step(&service, &episode, &both.1));
    let mut statuses = [both.0.status.as_u16(), both.1.status.as_u16()];
    statuses.sort_unstable();
    assert_eq!(statuses, [200, 409]);
    assert_eq!(service.get(&episode).await.json()["blocks"], 3);

    for (body, reason) in [
        (json!({}), "missing"),
        (json!({ "action_code": "1", "events": [] }), "events"),
        (json!({ "action_code": null }), "missing"),
        (json!({ "action_code": "while (true) {}" }), "stopped at a limit (time)"),
        (json!({ "events": [{ "action": "place", "x": 0, "y": 1e9, "z": 0, "material": "stone" }] }), "out of range"),
        (json!({ "events": [], "step": 0 }), "out of range"),
        (json!({ "events": [], "view": { "from": [0, 0, 0], "to": [99, 99, 99] } }), "more than 32768 cells"),
        (json!({ "events": [], "view": { "from": [0, 0], "to": [1, 1, 1] } }), "expected {\\\"from\\\""),
        (json!({ "code": "1" }), "unknown field"),
    ] {
        let refused = step(&service, &episode, &body).await;
        assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY, "{}", refused.text);
        assert!(refused.text.contains(reason), "{reason}: {}", refused.text);
    }
    assert_eq!(service.get(&episode).await.json()["step"], 3);
    for (path, status, reason) in [
        ("/view?from=0,0,0&to=1,1", 400, "three integers"),
        ("/view?from=0,0,0", 400, "missing"),
        ("/picture?from=above", 400, "south-east"),
    ] {
        let answer = service.get(&format!("{episode}{path}")).await;
        assert_eq!(answer.status, status, "{}", answer.text);
        assert!(answer.text.contains(reason), "{}", answer.text);
    }
    let last = service.post_json(&format!("{episode}/next-turn"), &json!({})).await;
    assert!(last.text.contains("last-turn"), "{}", last.text);
    for (body, reason) in [
        (json!({ "task": "walls/none" }), "has no task"),
        (json!({ "task": "walls/5x1x5-raise", "suite": "none" }), "there is no suite"),
        (json!({ "task": "walls/5x1x5-raise", "run": "none" }), "there is no run"),
        (json!({ "suite": "mineceraft" }), "missing"),
    ] {
        let refused = service.post_json("/v1/episodes", &body).await;
        assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY, "{}", refused.text);
        assert!(refused.text.contains(reason), "{}", refused.text);
    }
    assert_eq!(service.get("/v1/episodes/none").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn an_episode_survives_a_kill_between_any_two_requests() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let episode = open(&service, &json!({ "task": task_of_turns(1).id })).await;
    service.kill();
    let service = start(folder.path());
    let code = "await skills.goToPosition(bot, 4, 0, 4); await skills.placeBlock(bot, 'stone', 0, 0, 0);";
    let made = step(&service, &episode, &json!({ "step": 1, "action_code": code })).await;
    service.kill();
    let service = start(folder.path());
    assert_eq!(step(&service, &episode, &json!({ "step": 1, "action_code": code })).await.text, made.text);
    let again = service.get(&episode).await.json();
    assert_eq!(
        (&again["step"], &again["blocks"], &again["position"]),
        (&json!(1), &json!(1), &made.json()["position"])
    );
    let submitted = service.post_json(&format!("{episode}/submit"), &json!({})).await.json();
    service.kill();
    let service = start(folder.path());
    assert_eq!(service.post_json(&format!("{episode}/submit"), &json!({})).await.json(), submitted);
}

#[tokio::test]
async fn killed_around_each_commit_an_episode_becomes_one_submission_with_every_step() {
    let commits = ["open_episode", "advance_episode", "close_episode", "accept", "end_episode"];
    for moment in commits.into_iter().flat_map(|commit| [format!("before {commit}"), format!("after {commit}")]) {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("p.db");
        start(folder.path()).kill();
        let mut command = std::process::Command::new(PROGRAM);
        command.env("PLUMBLINE_TEST_KILL", &moment);
        let mut service = Service::start_by(command, &database, &["--workers", "2", "--open"]);
        // A client that repeats what was not answered, with the number of the step.
        let mut is_dead = false;
        let mut answers = Vec::new();
        let step = json!({ "step": 1, "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);" });
        for (path, body) in [("", json!({ "task": "walls/5x1x5-raise" })), ("/steps", step), ("/submit", json!({}))] {
            let episode = answers.first().map(|opened: &Value| format!("/{}", id(opened))).unwrap_or_default();
            let url = format!("/v1/episodes{episode}{path}");
            loop {
                match service.http.post(format!("{}{url}", service.url)).json(&body).send().await {
                    Ok(answer) if answer.status().is_success() => {
                        answers.push(answer.json().await.unwrap());
                        break;
                    }
                    Ok(answer) => panic!("{moment}: {path}: {}", answer.text().await.unwrap()),
                    Err(_) => {
                        assert!(!is_dead, "{moment}: died twice");
                        is_dead = true;
                        service.wait_for_end(&moment).await;
                        service = start(folder.path());
                    }
                }
            }
        }
        assert!(is_dead, "{moment}: never reached");
        assert_eq!((&answers[1]["blocks"], &answers[1]["step"]), (&json!(1), &json!(1)), "{moment}");
        let path = format!("/v1/submissions/{}", answers[2]["submission"].as_str().unwrap());
        service.wait_for(&path, |submission| submission["state"] == "graded").await;
        let report = service.get(&format!("{path}/report")).await.json();
        assert_eq!(report["turns"][0]["blocks"], 1, "{moment}");
        let counted = service.get("/metrics").await.text;
        assert!(counted.contains("plumbline_submissions_not_ended 0"), "{moment}");
        let pool = pool(&database).await;
        let stored: i64 = query_scalar("SELECT COUNT(*) FROM submissions").fetch_one(&pool).await.unwrap();
        assert_eq!(stored, 1, "{moment}");
        pool.close().await;
    }
}

#[tokio::test]
async fn events_are_what_the_world_can_hold() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let episode = open(&service, &json!({ "task": "walls/5x1x5-raise" })).await;
    let place =
        |x: i32, y: i32, material: &str| json!({ "action": "place", "x": x, "y": y, "z": 0, "material": material });
    let wrong = json!([place(0, 0, "stone"), place(1, 0, "mod:thing"), place(2, 0, "木头"), place(3, 400, "stone")]);
    let faults = step(&service, &episode, &json!({ "events": wrong })).await.faults(422);
    assert_eq!(faults, ["null /events/1/material", "null /events/2/material", "null /events/3/y"]);
    let fine = json!([
        place(0, 0, "minecraft:stone"),
        place(1, 0, "oak_stairs[half=top]"),
        place(2, 0, "dirt"),
        place(2, 0, "air")
    ]);
    let done = step(&service, &episode, &json!({ "events": fine })).await.json();
    assert_eq!(done["blocks"], 2, "{done}");
    let named: Vec<&str> =
        done["events"].as_array().unwrap().iter().filter_map(|event| event["material"].as_str()).collect();
    assert_eq!(named, ["stone", "oak_stairs", "dirt"]);
    let submitted = service.post_json(&format!("{episode}/submit"), &json!({})).await.json();
    let path = format!("/v1/submissions/{}", submitted["submission"].as_str().unwrap());
    let log = service.get(&format!("{path}/log")).await.json();
    assert_eq!(log["palette"], json!(["stone", "oak_stairs", "dirt"]), "{log}");
    let promised =
        service.post_json(&format!("{episode}/submit"), &json!({ "transcript_sha256": "a".repeat(64) })).await;
    assert!(promised.text.contains("hidden instance"), "{}", promised.text);
    let garbage = service.post(&format!("{episode}/submit"), "application/json", "garbage{").await;
    assert_eq!(garbage.status, StatusCode::BAD_REQUEST, "{}", garbage.text);
}

#[tokio::test]
async fn the_world_is_the_same_after_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let task = "walls/5x1x5-raise";
    let parts = [
        "bot.chat('/gamerule commandModificationBlockLimit 100000'); bot.chat('/setblock 0 0 -9 oak_door[facing=east,half=lower]');",
        "bot.chat('/fill 0 0 0 39 29 29 stone'); bot.chat('/setblock 0 0 -9 oak_door[facing=east,half=lower]');",
    ];
    let episode = open(&service, &json!({ "task": task })).await;
    let mut events = 0;
    for part in parts {
        let done = step(&service, &episode, &json!({ "action_code": part })).await.json();
        events += done["events"].as_array().unwrap().len() as u64 + done["events_left_out"].as_u64().unwrap();
    }
    let replay = json!({ "profile": "mindcraft", "action_code": parts });
    let at_once = service.post_json("/v1/replay", &replay).await.json();
    assert_eq!(events, at_once["events"].as_array().unwrap().len() as u64);
    assert!(events > 36_000);
}

#[tokio::test]
async fn a_hidden_instance_is_attempted_under_the_rules_of_disclosure() {
    let scene = Scene::new(&[]);
    let (lab, other) = (scene.key("lab"), scene.key("other"));
    let entry = scene.register(&lab, "official", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let body = json!({ "instance": id(&drawn[0]) });
    let stranger = scene.post(&other, "/v1/episodes", &body).await;
    assert_eq!(stranger.status, StatusCode::FORBIDDEN, "{}", stranger.text);
    let opened = scene.made(&lab, "/v1/episodes", &body).await;
    assert_eq!(
        (&opened["prompt"], &opened["task"], &opened["suite"]),
        (&drawn[0]["prompts"][0], &Value::Null, &Value::Null)
    );
    let path = format!("/v1/episodes/{}", id(&opened));
    let code = json!({ "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);" });
    let refused = scene.post(&other, &format!("{path}/steps"), &code).await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN, "{}", refused.text);
    assert_eq!(scene.service.get(&path).await.status, StatusCode::UNAUTHORIZED);
    let done = scene.made(&lab, &format!("{path}/steps"), &code).await;
    assert_eq!(done["blocks"], 1);
    let hash = "a".repeat(64);
    let told = scene.made(&lab, &format!("{path}/submit"), &json!({ "transcript_sha256": hash })).await;
    assert_eq!((&told["submission"], &told["answer"]["instance"]), (&Value::Null, &drawn[0]["id"]), "{told}");
    assert!(told["answer"]["receipt"].to_string().contains(&hash), "{told}");
    let again = scene.made(&lab, &format!("{path}/submit"), &json!({})).await;
    assert_eq!(
        (&again["answer"]["log_sha256"], &again["answer"]["repeated"]),
        (&told["answer"]["log_sha256"], &json!(true))
    );
    for secret in ["family", "checks", "score", "criteria", "walls"] {
        assert!(![&opened, &done, &told].iter().any(|answer| answer.to_string().contains(secret)), "{secret}");
    }
    scene.refused(&lab, "/v1/episodes", &body, "already-answered").await;
    // A structure file would tell by its refusal whether the order is checked.
    let file = json!({ "turns": [{ "structure": "" }] });
    let refused = scene.post(&lab, &format!("/v1/instances/{}/answer", id(&drawn[1])), &file).await;
    assert!(refused.text.contains("take no structure files"), "{}", refused.text);
}

/// What is damaged is told as ours, and not as something that the same request may mend.
#[tokio::test]
async fn a_damaged_episode_is_told_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path());
    let task = task_of_turns(1);
    let (whole, damaged) = (
        open(&service, &json!({ "task": task.id, "suite": "mineceraft" })).await,
        open(&service, &json!({ "task": task.id, "suite": "mineceraft" })).await,
    );
    let first = step(&service, &damaged, &json!({ "step": 1, "events": [] })).await;
    assert_eq!(first.status, StatusCode::OK, "{}", first.text);
    let pool = pool(&folder.path().join("p.db")).await;
    let id = damaged.rsplit('/').next().unwrap();
    let spoilt = query("UPDATE episodes SET state = $1 WHERE id = $2").bind(vec![1_u8, 2, 3]).bind(id.to_owned());
    assert_eq!(spoilt.execute(&pool).await.unwrap(), 1);
    let another = json!({ "step": 2, "events": [] });
    for answer in [
        service.get(&damaged).await,
        step(&service, &damaged, &another).await,
        service.post_json(&format!("{damaged}/submit"), &json!({})).await,
    ] {
        let problem = answer.json();
        assert_eq!(answer.status, StatusCode::INTERNAL_SERVER_ERROR, "{problem}");
        assert_eq!((&problem["type"], &problem["retryable"]), (&json!("urn:plumbline:problem:damaged"), &json!(false)));
        assert!(answer.headers.get("retry-after").is_none());
    }
    assert_eq!(step(&service, &whole, &json!({ "step": 1, "events": [] })).await.status, StatusCode::OK);
}
