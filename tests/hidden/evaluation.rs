//! Hidden evaluation as an outside lab goes through it, over HTTP: register, draw, build, answer, finalize; then the
//! epoch closes, everything is revealed and verified, and a changed bit is found.

use crate::support::database;
use crate::support::epoch::{CONFIGURATION, Scene, answer_to, id, run, said};
use plumbline::store::db::query;
use reqwest::StatusCode;
use serde_json::{Value, json};

#[tokio::test]
async fn a_lab_goes_through_an_epoch_and_checks_what_it_revealed() {
    let scene = Scene::new(&[]);
    let (lab, other) = (scene.key("lab"), scene.key("other"));
    let service = &scene.service;
    std::fs::write(scene.file("kept.json"), service.get("/v1/epochs/autumn").await.text).unwrap();
    let epoch = service.get("/v1/epochs/autumn").await.json();
    let per_run = epoch["commitment"]["instances_per_run"].as_u64().unwrap() as usize;
    assert_eq!((epoch["state"].as_str(), per_run), (Some("open"), 26));

    // Registered before anything is seen; drawn once; another's key opens nothing.
    let entry = scene.register(&lab, "official", 2).await;
    let draw = format!("/v1/entries/{entry}/instances");
    let first = scene.draw(&lab, &entry, 1).await;
    assert_eq!(first.len(), per_run);
    assert_eq!(scene.draw(&lab, &entry, 1).await, first, "the same nonce gives the same instances");
    scene.refused(&lab, &draw, &json!({ "run": 1, "nonce": "another nonce, later" }), "already-drawn").await;
    let fault = scene.post(&lab, &draw, &json!({ "run": 3, "nonce": "a nonce of our own 3" })).await;
    assert_eq!(fault.faults(422), ["null /run"]);
    let faults = scene.post(&lab, &draw, &json!({ "run": 3, "nonce": "short" })).await.faults(422);
    assert_eq!(faults, ["null /nonce", "null /run"]);
    let wrong = json!({ "agent": "", "configuration_sha256": "abc", "tier": "open", "runs": 17 });
    let refused = scene.post(&lab, "/v1/epochs/autumn/entries", &wrong).await;
    let mut faults = refused.faults(422);
    faults.sort();
    assert_eq!(faults, ["null /agent", "null /configuration_sha256", "null /runs", "null /tier"]);
    assert!(refused.text.contains("17 is out of range: 1 to 16"), "{}", refused.text);
    let foreign = scene.post(&other, &draw, &json!({ "run": 2, "nonce": "a nonce of another" })).await;
    assert_eq!(foreign.status, StatusCode::FORBIDDEN, "{}", foreign.text);
    let path = format!("/v1/instances/{}", id(&first[0]));
    assert_eq!(service.get(&path).await.status, StatusCode::UNAUTHORIZED);
    for hidden in ["checks", "family", "leaf", "parameters", "task"] {
        assert!(first.iter().all(|instance| instance.get(hidden).is_none()), "{hidden} is told");
    }
    let second = scene.draw(&lab, &entry, 2).await;
    let prompts = |instances: &[Value]| instances.iter().map(|own| own["prompts"].to_string()).collect::<Vec<_>>();
    assert!(prompts(&second).iter().all(|own| !prompts(&first).contains(own)), "a specification was issued twice");

    // One log each: three spoiled in the first run, the last of the second run not answered at all.
    scene.answer(&lab, &first, 3).await;
    scene.answer(&lab, &second[..per_run - 1], 0).await;
    let pool = scene.pool();
    let path = format!("/v1/instances/{}/answer", id(&first[5]));
    let again = scene.made(&lab, &path, &answer_to(&first[5], &pool, false)).await;
    assert_eq!(again["repeated"], true);
    a_damaged_receipt_is_told_as_that(&scene, &lab, &first[5]).await;
    scene.refused(&lab, &path, &answer_to(&first[5], &pool, true), "already-answered").await;
    let broken =
        json!({ "turns": [{ "events": [{ "action": "place", "x": 0.5, "y": 0, "z": 0, "material": "stone" }] }] });
    let last = format!("/v1/instances/{}/answer", id(&second[per_run - 1]));
    let broken = scene.post(&lab, &last, &broken).await;
    assert_eq!(broken.faults(422), ["null /turns/0/events/0/x"]);

    // Another configuration is no further attempt of the same.
    let new = json!({ "agent": "builder 2", "configuration_sha256": CONFIGURATION, "tier": "official", "runs": 1 });
    scene.refused(&lab, "/v1/epochs/autumn/entries", &new, "another-configuration").await;

    // Another lab in the dev tier is told its score when it has finalized, and not before.
    let dev = scene.register(&other, "dev", 1).await;
    let drawn = scene.draw(&other, &dev, 1).await;
    scene.answer(&other, &drawn, 6).await;
    assert_eq!(service.get(&format!("/v1/entries/{dev}")).await.json()["result"], Value::Null);
    scene.made(&other, &format!("/v1/entries/{dev}/finalize"), &json!({})).await;
    let told = service.wait_for(&format!("/v1/entries/{dev}"), |entry| entry["state"] == "complete").await;
    is_told_in_part(&told["result"]);
    let open = service.get("/v1/epochs/autumn/leaderboard?tier=dev").await.json();
    let board = &open;
    assert_eq!((board["rows"][0]["owner"].as_str(), board["rows"][0]["attempts"].as_u64()), (Some("other"), Some(1)));
    assert!(board["rows"][0]["of"].as_u64().unwrap() < 26, "the Ladder shows the part that did not decide: {board}");

    // The official entry is finalized; nothing is told before the epoch is over.
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    let unanswered = answer_to(&second[per_run - 1], &pool, false);
    scene.refused(&lab, &last, &unanswered, "finalized").await;
    let complete = service.wait_for(&format!("/v1/entries/{entry}"), |entry| entry["state"] == "complete").await;
    assert_eq!(complete["result"], Value::Null);
    let board = service.get("/v1/epochs/autumn/leaderboard").await.json();
    assert_eq!((&board["is_released"], &board["rows"], &board["registered"]), (&json!(false), &json!([]), &json!(1)));
    for path in ["reveal", "answers"] {
        let early = service.get(&format!("/v1/epochs/autumn/{path}")).await;
        assert_eq!(early.json()["type"], "urn:plumbline:problem:epoch-not-over", "{}", early.text);
    }
    let receipt = service.get(&format!("/v1/instances/{}/receipt", id(&first[5]))).await;
    assert_eq!(receipt.status, StatusCode::NOT_FOUND, "its place tells when it was graded: {}", receipt.text);

    // Over: scores, board, receipts, reveal.
    scene.end_epoch().await;
    let told = service.get(&format!("/v1/entries/{entry}")).await.json();
    assert_eq!((&told["result"]["passed"], &told["result"]["of"]), (&json!(48), &json!(52)), "{told}");
    let told = service.get(&format!("/v1/entries/{dev}")).await.json()["result"].clone();
    assert_eq!((&told["passed"], &told["of"], &told["told_later"]), (&json!(20), &json!(26), &Value::Null));
    let last = service.get("/v1/epochs/autumn/leaderboard?tier=dev").await.json();
    assert_eq!((&open["is_final"], &last["is_final"]), (&json!(false), &json!(true)));
    assert!(last["rows"][0]["of"].as_u64().unwrap() < 26 - open["rows"][0]["of"].as_u64().unwrap(), "{last}");
    let board = service.get("/v1/epochs/autumn/leaderboard").await.json();
    assert_eq!(
        (&board["rows"][0]["passed"], &board["rows"][0]["provenance"]),
        (&json!(48), &json!("nonce-bound")),
        "{board}"
    );
    let report = service.get(&format!("/v1/instances/{}/report", id(&first[5]))).await.json();
    assert_eq!(report["report"]["overall"], true, "{report}");
    for (name, path) in [("reveal.json", "reveal"), ("answers.ndjson", "answers")] {
        std::fs::write(scene.file(name), service.get(&format!("/v1/epochs/autumn/{path}")).await.text).unwrap();
    }
    let log = service.get("/v1/receipts?limit=1000").await.text;
    std::fs::write(scene.file("log.json"), &log).unwrap();
    let key =
        service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].as_str().unwrap().to_owned();
    verify_offline(&scene, &key);
}

/// Of a dev entry with 20 of 26 solved, a part is told before the end: a third on average is kept for the final board.
fn is_told_in_part(result: &Value) {
    let [passed, of, later] = ["passed", "of", "told_later"].map(|name| result[name].as_u64().unwrap());
    assert_eq!(of + later, 26, "{result}");
    assert!(later > 0 && passed <= 20 && of - passed <= 6, "{result}");
}

/// What the downloaded files alone show, and what changed ones do.
fn verify_offline(scene: &Scene, key: &str) {
    let checked = run(&["verify-receipt", scene.file("log.json").to_str().unwrap(), "--key", key], None);
    assert!(checked.status.success(), "{}", said(&checked));
    assert!(
        // An announcement, 2 entries, 3 draws, 77 answers with a place each, 2 ends with as many places, and the end of
        // all.
        said(&checked).contains("240 receipts of the log, each linked to the one before; 0 of them"),
        "{}",
        said(&checked)
    );
    let verify = |reveal: &str| {
        let file = |name: &str| scene.file(name).to_str().unwrap().to_owned();
        let arguments = ["--answers", &file("answers.ndjson"), "--commitment", &file("kept.json")];
        run(&[&["verify-epoch", file(reveal).as_str()], &arguments[..]].concat(), None)
    };
    let good = verify("reveal.json");
    assert!(good.status.success(), "{}", said(&good));
    assert!(said(&good).contains("78 of 78 specifications, 78 of 78 draws and 77 of 77 grades"), "{}", said(&good));

    // One bit of one specification changed afterwards: a number in a prompt.
    let mut reveal: Value = serde_json::from_slice(&std::fs::read(scene.file("reveal.json")).unwrap()).unwrap();
    let prompt = &mut reveal["specifications"][17]["task"]["turns"][0]["prompt"];
    let text = prompt.as_str().unwrap();
    *prompt = json!(text.replacen('Y', "X", 1));
    std::fs::write(scene.file("changed.json"), reveal.to_string()).unwrap();
    let bad = verify("changed.json");
    assert_eq!(bad.status.code(), Some(1), "{}", said(&bad));
    assert!(said(&bad).contains("BROKEN  leaf 17 ("), "{}", said(&bad));
    assert!(said(&bad).contains("BROKEN  root: "), "{}", said(&bad));

    // An instance taken out, and one drawn again.
    let text = std::fs::read_to_string(scene.file("reveal.json")).unwrap();
    for (name, change) in [("lacks instance", 0), ("has the family and index of an earlier instance", 1)] {
        let mut reveal: Value = serde_json::from_str(&text).unwrap();
        let instances = reveal["instances"].as_array_mut().unwrap();
        let last = instances.pop().unwrap();
        if change == 1 {
            instances.extend([last.clone(), last]);
        }
        std::fs::write(scene.file("changed.json"), reveal.to_string()).unwrap();
        let bad = verify("changed.json");
        assert!(bad.status.code() == Some(1) && said(&bad).contains(name), "{}", said(&bad));
    }

    // And a grade made better than it was.
    let text = std::fs::read_to_string(scene.file("reveal.json")).unwrap();
    std::fs::write(scene.file("better.json"), text.replacen("\"overall\":false", "\"overall\":true", 1)).unwrap();
    let bad = verify("better.json");
    assert!(bad.status.code() == Some(1) && said(&bad).contains("BROKEN  instance "), "{}", said(&bad));
}

#[tokio::test]
async fn a_run_that_was_drawn_is_answered_in_time_or_failed_and_budgets_end() {
    let scene = Scene::new(&[
        "--instance-seconds",
        "60",
        "--dev-entries",
        "2",
        "--budget-bits",
        "9",
        "--dev-feedback",
        "criteria",
    ]);
    let lab = scene.key("lab");
    // Registered once, however often it is sent.
    let new = json!({ "agent": "a", "configuration_sha256": CONFIGURATION, "tier": "dev", "runs": 1 });
    let register = || {
        let request =
            scene.service.http.post(format!("{}/v1/epochs/autumn/entries", scene.service.url)).bearer_auth(&lab);
        scene.service.send(request.header("idempotency-key", "first").json(&new))
    };
    let (first, again) = (register().await, register().await);
    assert_eq!((first.status, &first.json()["id"]), (again.status, &again.json()["id"]), "{}", again.text);
    assert_eq!(again.headers["idempotency-replayed"], "true");
    let entry = first.json()["id"].as_str().unwrap().to_owned();
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &drawn[1..6], 5).await;
    scene.set_clock(61_000);
    let body = answer_to(&drawn[0], &scene.pool(), false);
    scene.refused(&lab, &format!("/v1/instances/{}/answer", id(&drawn[0])), &body, "expired").await;
    scene.register(&lab, "dev", 1).await;
    let new = json!({ "agent": "b", "configuration_sha256": CONFIGURATION, "tier": "dev", "runs": 1 });
    scene.refused(&lab, "/v1/epochs/autumn/entries", &new, "no-entries-left").await;
    let finalized = scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    assert_eq!(finalized["runs"], 1);
    let ended = scene.service.wait_for(&format!("/v1/entries/{entry}"), |entry| entry["state"] == "complete").await;
    // Five answered, all failed; what that told spent the budget.
    assert_eq!((&ended["result"]["passed"], &ended["result"]["of"]), (&json!(0), &json!(26)), "{ended}");
    let epoch = scene.service.get("/v1/epochs/autumn").await.json();
    assert_eq!(epoch["state"], "closed", "{epoch}");
    assert!(epoch["closed_reason"].as_str().unwrap().contains("budget"), "{epoch}");
    scene.refused(&lab, "/v1/epochs/autumn/entries", &new, "epoch-not-open").await;
}

#[tokio::test]
async fn a_promised_transcript_is_checked_on_request() {
    use sha2::{Digest as _, Sha256};
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let transcript = json!({ "steps": ["think", "build"] });
    let mut body = answer_to(&drawn[0], &scene.pool(), false);
    body["transcript_sha256"] = plumbline_engine::tasks::hex(&Sha256::digest(transcript.to_string())).into();
    let path = format!("/v1/instances/{}", id(&drawn[0]));
    scene.made(&lab, &format!("{path}/answer"), &body).await;
    scene.refused(&lab, &format!("{path}/transcript"), &json!({ "steps": ["peek"] }), "another-transcript").await;
    let shown = scene.made(&lab, &format!("{path}/transcript"), &transcript).await;
    assert!(shown["transcript_checked_at"].is_string(), "{shown}");
}

/// Sends a request again until it is answered: the service may die under it, and is started again then.
async fn insist(scene: &mut Scene, key: &str, path: &str, body: &Value) -> Value {
    for _ in 0..5 {
        let request = scene.service.http.post(format!("{}{path}", scene.service.url)).bearer_auth(key).json(body);
        match request.send().await {
            Ok(answer) => {
                let (status, text) = (answer.status(), answer.text().await.unwrap());
                assert!(status.is_success(), "{path}: {status} {text}");
                return serde_json::from_str(&text).unwrap();
            }
            Err(_died) => scene.restart(None),
        }
    }
    panic!("{path} is never answered");
}

#[tokio::test]
async fn whenever_the_service_dies_nothing_is_drawn_or_answered_twice_and_the_books_agree() {
    for (commit, n) in
        [("issue_instances", 1), ("answer_instance", 3), ("record", 1), ("finalize_entry", 1), ("publish_hidden", 1)]
    {
        for side in ["before", "after"] {
            let mut scene = Scene::new(&[]);
            let lab = scene.key("lab");
            let entry = scene.register(&lab, "dev", 1).await;
            scene.restart(Some(&format!("{side} {commit} {n}")));
            let draw = json!({ "run": 1, "nonce": "a nonce of our own 1" });
            let drawn = insist(&mut scene, &lab, &format!("/v1/entries/{entry}/instances"), &draw).await;
            let pool = scene.pool();
            for (i, instance) in drawn["instances"].as_array().unwrap().iter().enumerate() {
                let body = answer_to(instance, &pool, i < 6);
                insist(&mut scene, &lab, &format!("/v1/instances/{}/answer", id(instance)), &body).await;
            }
            insist(&mut scene, &lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
            let mut result = Value::Null;
            for _ in 0..6_000 {
                match scene.service.http.get(format!("{}/v1/entries/{entry}", scene.service.url)).send().await {
                    Ok(answer) => result = serde_json::from_str::<Value>(&answer.text().await.unwrap()).unwrap(),
                    Err(_died) => scene.restart(None),
                }
                if result["state"] == "complete" {
                    break;
                }
                tokio::time::sleep(std::time::Duration::from_millis(50)).await;
            }
            let what = format!("{side} {commit}");
            is_told_in_part(&result["result"]);
            let epoch = scene.service.get("/v1/epochs/autumn").await.json();
            assert_eq!(
                (&epoch["issued"], &epoch["answered"], &epoch["released_bits"]),
                (&json!(26), &json!(26), &json!(7.6)),
                "{what}"
            );
            std::fs::write(scene.file("log.json"), scene.service.get("/v1/receipts?limit=1000").await.text).unwrap();
            let key = scene.service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].clone();
            let log = scene.file("log.json");
            let checked = run(&["verify-receipt", log.to_str().unwrap(), "--key", key.as_str().unwrap()], None);
            assert!(
                checked.status.success() && said(&checked).starts_with("82 receipts"),
                "{what}: {}",
                said(&checked)
            );
        }
    }
}

/// An answer may be what an agent wrote, with all its lines, in a fence or without.
#[tokio::test]
async fn answers_may_be_scripts_as_agents_write_them() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let folder = crate::support::repository("tests/conformance");
    let expected: Value =
        serde_json::from_slice(&std::fs::read(folder.join("actions_expected.json")).unwrap()).unwrap();
    let scripts = expected.as_object().unwrap().iter().filter(|(_, wanted)| wanted["expect"] != "timeout");
    for (i, ((name, wanted), instance)) in scripts.zip(&drawn).enumerate() {
        let code = std::fs::read_to_string(folder.join("actions").join(name)).unwrap();
        let code = if i % 2 == 0 { code } else { format!("Here you are:\n```js\n{code}```\n") };
        let mut turns = vec![json!({ "action_code": code })];
        turns.resize(instance["prompts"].as_array().unwrap().len(), json!({ "events": [] }));
        let path = format!("/v1/instances/{}/answer", id(instance));
        // Without a profile, code counts by that of the epoch.
        let profile = (name != "04_small_house.js").then_some("published");
        let body = json!({ "turns": turns, "transcript_sha256": null, "profile": profile });
        let answer = scene.post(&lab, &path, &body).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{name}: {}", answer.text);
        // In a game, a door and a bed are two blocks each.
        let more = if profile.is_none() { 2 } else { 0 };
        let events = wanted["events"].as_array().unwrap().len() + more;
        assert_eq!(answer.json()["action_code"][0]["events"], events, "{name}: {}", answer.text);
    }
}

/// Sending an answer again whose stored receipt is damaged changes nothing, and the response says so.
async fn a_damaged_receipt_is_told_as_that(scene: &Scene, lab: &str, instance: &Value) {
    let pool = database::pool(&scene.file("p.db")).await;
    for (from, to) in [("hash", "hush"), ("hush", "hash")] {
        let sql = format!("UPDATE instances SET receipt = replace(receipt, '\"{from}\":', '\"{to}\":') WHERE id = $1");
        query(sqlx::AssertSqlSafe(sql)).bind(id(instance)).execute(&pool).await.unwrap();
        let path = format!("/v1/instances/{}/answer", id(instance));
        let again = scene.post(lab, &path, &answer_to(instance, &scene.pool(), false)).await;
        if to == "hash" {
            assert_eq!(again.json()["repeated"], true, "{}", again.text);
        } else {
            let told = again.json();
            assert_eq!((again.status.as_u16(), &told["retryable"]), (500, &json!(false)), "{told}");
            assert_eq!(told["type"], "urn:plumbline:problem:damaged", "{told}");
        }
    }
    pool.close().await;
}
