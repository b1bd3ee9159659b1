//! Epochs whose pool is bound to a public randomness beacon: nobody knows a specification before the round.

use crate::support::beacon::{chain_hash, info, round};
use crate::support::database::{is_postgres, named};
use crate::support::epoch::{CONFIGURATION, Scene, id, run, said};
use axum::Router;
use axum::extract::Path;
use axum::routing::get;
use reqwest::StatusCode;
use serde_json::{Value, json};

/// Time from the creation of an epoch to its opening.
const OPENS_IN_MS: i64 = 600_000;

/// Announces an epoch that opens in ten minutes and is bound to a chain of our own.
fn bound_scene(more: &[&str]) -> Scene {
    let chain = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(chain.path(), info().to_string()).unwrap();
    let opens = jiff::Timestamp::now() + jiff::SignedDuration::from_millis(OPENS_IN_MS);
    let (opens, chain) = (opens.to_string(), chain.path().to_str().unwrap());
    Scene::new(&[&["--opens", &opens, "--beacon", "--beacon-chain", chain], more].concat())
}

async fn epoch(scene: &Scene) -> Value {
    scene.service.get("/v1/epochs/autumn").await.json()
}

fn committed_round(epoch: &Value) -> u64 {
    epoch["commitment"]["beacon"]["round"].as_u64().unwrap()
}

#[tokio::test]
async fn a_pool_is_made_from_the_committed_round_and_no_other() {
    let mut scene = bound_scene(&[]);
    let lab = scene.key("lab");
    let before = epoch(&scene).await;
    let number = committed_round(&before);
    assert_eq!((&before["state"], &before["pool"]), (&json!("committed"), &Value::Null));
    assert!(before["commitment"].get("root").is_none(), "nobody knows the specifications: {before}");
    assert!(!scene.file("p.db.secrets/epoch-autumn.pool.json").exists());

    // Entries come before the round, draws after it.
    let entry = scene.register(&lab, "official", 2).await;
    let draw = json!({ "run": 1, "nonce": "a nonce of our own 1" });
    scene.refused(&lab, &format!("/v1/entries/{entry}/instances"), &draw, "epoch-not-open").await;
    scene.refused("", "/v1/epochs/autumn/beacon", &round(number), "round-not-due").await;
    scene.set_clock(OPENS_IN_MS + 5_000);
    scene.refused(&lab, &format!("/v1/entries/{entry}/instances"), &draw, "no-pool").await;
    let page = scene.service.get("/epochs/autumn").await.text;
    assert!(page.contains(&format!("/public/{number}")) && page.contains("not the public one"), "{page}");
    let new = json!({ "agent": "late", "configuration_sha256": CONFIGURATION, "tier": "official", "runs": 1 });
    scene.refused(&lab, "/v1/epochs/autumn/entries", &new, "registration-over").await;
    scene.register(&lab, "dev", 1).await;

    // Whatever is not the round changes nothing.
    let mut forged = round(number);
    forged["signature"] = round(number + 1)["signature"].clone();
    for (body, pointer) in [
        (round(number + 1), "/round"),
        (forged, "/signature"),
        (json!({ "round": number, "signature": "00".repeat(48) }), "/signature"),
        (json!({ "round": number, "signature": "zz" }), "/signature"),
        (json!({ "round": null, "signature": null }), "/round"),
        (json!({ "round": "\t1" }), "/round"),
        (json!([]), ""),
    ] {
        let answer = scene.post("", "/v1/epochs/autumn/beacon", &body).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{body}: {}", answer.text);
        assert!(answer.json()["faults"].to_string().contains(pointer), "{body}: {}", answer.text);
    }
    assert_eq!(scene.post("", "/v1/epochs/none/beacon", &round(number)).await.status, StatusCode::NOT_FOUND);
    assert_eq!(epoch(&scene).await["pool"], Value::Null);

    // Anybody brings it, without a key; two at once make one pool.
    let given = round(number);
    let (one, other) = tokio::join!(
        scene.post("", "/v1/epochs/autumn/beacon", &given),
        scene.post("", "/v1/epochs/autumn/beacon", &given)
    );
    assert_eq!((one.status, other.status), (StatusCode::OK, StatusCode::OK), "{} {}", one.text, other.text);
    let pool = one.json()["pool"].clone();
    assert_eq!((&pool, &pool["round"]), (&other.json()["pool"], &json!(number)));
    let receipts = scene.service.get("/v1/receipts").await.json();
    let announced: Vec<&Value> = receipts["receipts"].as_array().unwrap().iter().map(|own| &own["receipt"]).collect();
    assert_eq!(announced[0]["epoch"]["commitment"], before["commitment"], "the log announces the epoch");
    assert!(announced.iter().any(|own| own["pool"] == pool), "and the pool: {announced:?}");

    let drawn = scene.draw(&lab, &entry, 1).await;
    // The pool follows from key and round, so a damaged or lost file of it loses nothing, and is written again.
    let file = scene.file("p.db.secrets/epoch-autumn.pool.json");
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    scene.restart(None);
    assert_eq!(scene.draw(&lab, &entry, 1).await, drawn);
    assert!(!scene.draw(&lab, &entry, 2).await.is_empty());
    assert_eq!(std::fs::read(&file).unwrap(), whole);
    std::fs::remove_file(&file).unwrap();
    scene.restart(None);
    assert_eq!(scene.draw(&lab, &entry, 1).await, drawn);
    assert_eq!(std::fs::read(&file).unwrap(), whole);
    let page = scene.service.get("/epochs/autumn").await.text;
    assert!(page.contains(&chain_hash()) && page.contains(pool["root"].as_str().unwrap()), "{page}");
}

#[tokio::test]
async fn an_epoch_whose_round_never_came_is_revealed_without_a_pool() {
    let scene = bound_scene(&[]);
    let lab = scene.key("lab");
    scene.register(&lab, "official", 1).await;
    scene.register(&lab, "dev", 1).await;
    std::fs::write(scene.file("kept.json"), epoch(&scene).await.to_string()).unwrap();
    let number = committed_round(&epoch(&scene).await);
    scene.end_epoch().await;
    scene.refused("", "/v1/epochs/autumn/beacon", &round(number), "epoch-not-open").await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.text;
    std::fs::write(scene.file("reveal.json"), &reveal).unwrap();
    let [reveal, kept] = ["reveal.json", "kept.json"].map(|name| scene.file(name).to_str().unwrap().to_owned());
    let verified = run(&["verify-epoch", &reveal, "--commitment", &kept], None);
    assert!(verified.status.success() && said(&verified).contains("nothing was drawn"), "{}", said(&verified));
    // Nobody could draw, so nobody failed.
    for tier in ["official", "dev"] {
        let board = scene.service.get(&format!("/v1/epochs/autumn/leaderboard?tier={tier}")).await.json();
        assert_eq!((&board["is_released"], &board["rows"]), (&json!(true), &json!([])), "{board}");
    }
    let page = scene.service.get("/epochs/autumn").await.text;
    assert!(page.contains("the round was not brought before the end"), "{page}");
}

#[tokio::test]
async fn the_service_fetches_the_round_itself_and_the_command_takes_a_file() {
    let answer = async |Path((chain, number)): Path<(String, u64)>| {
        assert_eq!(chain, chain_hash());
        round(number).to_string()
    };
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let server = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(axum::serve(listener, Router::new().route("/{chain}/public/{round}", get(answer))).into_future());

    let mut scene = bound_scene(&[]);
    scene.options = vec!["--beacon-url".to_owned(), server];
    scene.restart(None);
    tokio::time::sleep(std::time::Duration::from_secs(2)).await;
    assert_eq!(epoch(&scene).await["pool"], Value::Null, "not before the round is due");
    scene.set_clock(OPENS_IN_MS + 5_000);
    scene.service.wait_for("/v1/epochs/autumn", |found| !found["pool"].is_null()).await;

    // The command has a clock of its own.
    let other = bound_scene(&[]);
    let number = committed_round(&epoch(&other).await);
    std::fs::write(other.file("round.json"), round(number).to_string()).unwrap();
    std::fs::write(other.file("page.html"), "<!doctype html>").unwrap();
    let epochs = |arguments: &[&str]| {
        let mut command = std::process::Command::new(crate::support::PROGRAM);
        command.env("PLUMBLINE_TEST_CLOCK", other.file("clock")).current_dir(other.folder.path()).arg("epochs");
        said(&command.args(arguments).args(named(&other.file("p.db"))).output().unwrap())
    };
    assert!(epochs(&["beacon", "autumn", "--from", "round.json"]).contains("not yet"));
    other.set_clock(OPENS_IN_MS + 5_000);
    let listed = epochs(&["list"]);
    assert!(listed.contains(&format!("round {number} of its beacon is missing")), "{listed}");
    let closed = "http://127.0.0.1:9";
    for (from, told) in
        [("nowhere", "--from"), ("page.html", "expected a round"), ("", "--from"), (closed, "--from FILE")]
    {
        let refused = epochs(&["beacon", "autumn", "--from", from]);
        assert!(refused.contains(told), "{from:?}: {refused}");
    }
    assert!(epochs(&["beacon", "winter"]).contains("there is no epoch"));
    let made = epochs(&["beacon", "autumn", "--from", "round.json"]);
    let pool = epoch(&other).await["pool"].clone();
    assert!(made.contains(pool["root"].as_str().unwrap()), "{made}");
}

#[test]
fn an_epoch_is_bound_to_a_chain_that_can_be_verified() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    assert!(run(&["migrate", "--create"], Some(&database)).status.success());
    let chain = folder.path().join("chain.json");
    let mut chained = info();
    chained["schemeID"] = json!("pedersen-bls-chained");
    std::fs::write(&chain, chained.to_string()).unwrap();
    let chain = chain.to_str().unwrap();
    let times = ["--opens", "2100-01-01T00:00:00Z", "--closes", "2100-01-02T00:00:00Z"];
    let create = |more: &[&str]| run(&[&["epochs", "create", "x"], more].concat(), Some(&database));
    for (more, told) in [
        (vec!["--beacon", "--closes", "2100-01-01"], "--opens"),
        (vec!["--beacon-chain", chain, "--closes", "2100-01-01"], "--beacon"),
        ([&times[..], &["--beacon", "--beacon-chain", chain]].concat(), "bls-unchained-g1-rfc9380"),
        ([&times[..], &["--beacon", "--beacon-chain", "missing"]].concat(), "missing"),
    ] {
        let refused = create(&more);
        assert!(!refused.status.success() && said(&refused).contains(told), "{more:?}: {}", said(&refused));
    }
    let made = create(&[&times[..], &["--beacon", "--per-instance", "2"]].concat());
    assert!(made.status.success(), "{}", said(&made));
    let commitment: Value = serde_json::from_slice(&made.stdout).unwrap();
    // The first round of quicknet in the year 2100.
    let beacon = &commitment["beacon"];
    let at = |round: i64| 1_692_803_367 + 3 * (round - 1);
    let number = beacon["round"].as_i64().unwrap();
    assert!(at(number) >= 4_102_444_800 && at(number - 1) < 4_102_444_800, "{beacon}");
    assert_eq!(commitment["specifications"], json!(52));
}

/// An epoch from its announcement to its end, with everything that is published.
#[tokio::test]
async fn every_field_of_what_is_published_is_verified() {
    let scene = bound_scene(&["--per-instance", "1", "--siblings"]);
    let lab = scene.key("lab");
    let early = epoch(&scene).await;
    let entry = scene.register(&lab, "official", 1).await;
    scene.set_clock(OPENS_IN_MS + 5_000);
    scene.made("", "/v1/epochs/autumn/beacon", &round(committed_round(&early))).await;
    let late = epoch(&scene).await;
    let instances = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &instances, 3).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.end_epoch().await;
    let get = async |path: &str| scene.service.get(path).await.json();
    let published = crate::hidden::fields::Published {
        early,
        late,
        reveal: get("/v1/epochs/autumn/reveal").await,
        answers: scene.service.get("/v1/epochs/autumn/answers").await.text,
        log: get("/v1/receipts?limit=1000").await,
        board: get("/v1/epochs/autumn/leaderboard").await,
    };
    assert_eq!(id(&instances[0]), published.reveal["instances"][0]["id"]);
    if is_postgres() {
        // What follows reads documents alone, whichever database the epoch was in.
        return;
    }
    published.must_show_every_change();
}
