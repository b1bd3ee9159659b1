//! The contamination gauge: an agent that has learned the public list by heart is told from one that builds.

use std::collections::BTreeSet;

use crate::support::epoch::{Scene, answer_to, id, run, said};
use plumbline_engine::hidden::tlog::tree::{Tree, leaf};
use plumbline_engine::tasks::hex;
use serde_json::{Value, json};

#[tokio::test]
async fn an_agent_that_knows_the_public_list_shows_on_the_board() {
    let scene = Scene::new(&["--siblings"]);
    let service = &scene.service;
    let epoch = service.get("/v1/epochs/autumn").await.json();
    let per_run = epoch["commitment"]["instances_per_run"].as_u64().unwrap() as usize;
    let version = &epoch["commitment"]["generator_version"];

    // Anybody can have the list, from the service and from the program.
    let list = service.get(&format!("/v1/siblings?generator_version={version}")).await;
    assert_eq!(list.headers["content-type"], "application/x-ndjson");
    let printed = run(&["tasks", "siblings"], None);
    assert_eq!(String::from_utf8(printed.stdout).unwrap(), list.text);
    let drawn = run(&["tasks", "siblings", "--draw"], None);
    assert_eq!(String::from_utf8(drawn.stdout).unwrap(), list.text);
    let specifications: Vec<Value> = list.text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(epoch["commitment"]["siblings"]["specifications"], specifications.len());
    let prompts_of = |task: &Value| -> Vec<Value> {
        task["turns"].as_array().unwrap().iter().map(|turn| turn["prompt"].clone()).collect()
    };
    let known: BTreeSet<String> =
        specifications.iter().map(|own| json!(prompts_of(&own["task"])).to_string()).collect();
    let is_sibling = |instance: &Value| known.contains(&instance["prompts"].to_string());
    for unknown in ["1", "9"] {
        let missing = service.get(&format!("/v1/siblings?generator_version={unknown}")).await;
        assert_eq!(missing.status, 404, "{}", missing.text);
        assert!(missing.text.contains("versions 3 to 4 do"), "{}", missing.text);
    }
    let known = service.http.get(format!("{}/v1/siblings", service.url)).header("if-none-match", &list.headers["etag"]);
    assert_eq!(service.send(known).await.status, 304);
    // Each version has its list, whichever was asked for first.
    let earlier = service.get("/v1/siblings?generator_version=3").await;
    assert!(earlier.text != list.text && earlier.headers["etag"] != list.headers["etag"]);
    let again = service.get("/v1/siblings").await;
    assert!(again.text == list.text && again.headers["etag"] == list.headers["etag"]);
    // The root is that of a Merkle tree over the lines.
    let mut tree = Tree::default();
    list.text.lines().for_each(|line| tree.push(leaf(line.as_bytes())));
    assert_eq!(epoch["commitment"]["siblings"]["root"], hex(&tree.root(tree.len()).unwrap()));

    // An official run has a sibling beside each instance, and does not mark it; a dev run has none.
    let pool = scene.pool();
    for (owner, builds) in [("learned", false), ("builds", true)] {
        let key = scene.key(owner);
        let new = json!({ "agent": owner, "configuration_sha256": owner_hash(owner), "tier": "official", "runs": 1 });
        let entry = id(&scene.made(&key, "/v1/epochs/autumn/entries", &new).await).to_owned();
        let drawn = scene.draw(&key, &entry, 1).await;
        assert_eq!(drawn.len(), 2 * per_run);
        assert_eq!(drawn.iter().filter(|own| is_sibling(own)).count(), per_run);
        assert!(drawn.iter().all(|own| own.as_object().unwrap().keys().all(|name| !name.contains("sibling"))));
        for instance in &drawn {
            let body = answer_to(instance, &pool, !builds && !is_sibling(instance));
            scene.made(&key, &format!("/v1/instances/{}/answer", id(instance)), &body).await;
        }
        scene.made(&key, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    }
    let dev = scene.key("dev");
    let entry = scene.register(&dev, "dev", 1).await;
    assert!(scene.draw(&dev, &entry, 1).await.iter().all(|own| !is_sibling(own)));

    scene.end_epoch().await;
    let board = service.get("/v1/epochs/autumn/leaderboard").await.json();
    let row = |owner: &str| board["rows"].as_array().unwrap().iter().find(|row| row["owner"] == owner).unwrap();
    let (learned, builds) = (row("learned"), row("builds"));
    assert_eq!(
        (&builds["passed"], &builds["of"]),
        (&json!(per_run), &json!(per_run)),
        "siblings do not count: {board}"
    );
    assert_eq!((&builds["gauge"]["gap"], &builds["gauge"]["pairs"]), (&json!(0.0), &json!(per_run)));
    assert!(builds["gauge"]["interval"]["low"].as_f64().unwrap() < 0.0);
    assert_eq!((&learned["passed"], &learned["gauge"]["gap"]), (&json!(0), &json!(1.0)), "{board}");
    assert!(learned["gauge"]["interval"]["low"].as_f64().unwrap() > 0.5, "{board}");
    let page = service.get("/epochs/autumn").await.text;
    assert!(page.contains("public − hidden") && page.contains("+100 ("), "the page shows the gauge");
    let result = service.get(&format!("/v1/entries/{}", learned["entries"][0].as_str().unwrap())).await.json();
    assert_eq!(result["result"]["siblings"], json!({ "passed": per_run, "of": per_run }), "{result}");
    let told = result["result"]["instances"].as_array().unwrap();
    assert_eq!(told.iter().filter(|own| own["sibling"] == true).count(), per_run, "{result}");
    let epoch_now = service.get("/v1/epochs/autumn").await.json();
    assert_eq!((&epoch_now["issued"], &epoch_now["siblings_answered"]), (&json!(3 * per_run), &json!(2 * per_run)));

    // A reader checks draws, grades and gauge with the files alone, and finds a gauge that was made up.
    for (name, path) in [("reveal.json", "reveal"), ("answers.ndjson", "answers")] {
        std::fs::write(scene.file(name), service.get(&format!("/v1/epochs/autumn/{path}")).await.text).unwrap();
    }
    std::fs::write(scene.file("kept.json"), epoch.to_string()).unwrap();
    let verify = |board: &Value| {
        std::fs::write(scene.file("board.json"), board.to_string()).unwrap();
        let file = |name: &str| scene.file(name).to_str().unwrap().to_owned();
        let (reveal, answers, kept, board) =
            (file("reveal.json"), file("answers.ndjson"), file("kept.json"), file("board.json"));
        run(&["verify-epoch", &reveal, "--answers", &answers, "--commitment", &kept, "--board", &board], None)
    };
    let good = verify(&board);
    assert!(good.status.success(), "{}", said(&good));
    let grades = 4 * per_run;
    assert!(said(&good).contains(&format!("{grades} of {grades} grades")), "{}", said(&good));
    let mut changed = board.clone();
    for row in changed["rows"].as_array_mut().unwrap() {
        row["gauge"]["gap"] = json!(0.0);
    }
    let bad = verify(&changed);
    assert_eq!(bad.status.code(), Some(1));
    assert!(said(&bad).contains("gauge is {"), "the member is named: {}", said(&bad));
}

/// A hash that stands for the configuration of an owner's agent.
fn owner_hash(owner: &str) -> String {
    hex(&owner.bytes().cycle().take(32).collect::<Vec<u8>>())
}
