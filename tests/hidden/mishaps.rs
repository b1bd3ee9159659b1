//! What goes wrong on the operator's side during an epoch: a key that is away, a clock that jumps.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

use crate::support::epoch::{Scene, all_are_graded, answer_to, id, run, said};
use plumbline_engine::hidden::verify::{Kept, verify};
use reqwest::StatusCode;
use serde_json::{Value, json};

const NONCE: &str = "a nonce of our own 1";

#[tokio::test]
async fn an_epoch_without_its_key_waits_for_it() {
    let mut scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let secrets = scene.file("p.db.secrets");
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&secrets), mode(&secrets.join("epoch-autumn.json"))), (0o700, 0o600));
    if !crate::support::database::is_postgres() {
        let copy = scene.file("copy.db");
        let copied = run(&["backup", copy.to_str().unwrap()], Some(&scene.file("p.db")));
        assert!(copied.status.success() && !scene.file("copy.db.secrets").exists(), "{}", said(&copied));
        let asked = scene.file("asked.db");
        let copied = run(&["backup", asked.to_str().unwrap(), "--with-secrets"], Some(&scene.file("p.db")));
        assert!(copied.status.success(), "{}", said(&copied));
        assert_eq!(mode(&scene.file("asked.db.secrets/epoch-autumn.json")), 0o600);
    }
    let entry = scene.register(&lab, "official", 1).await;
    // A key that is not there is told before anybody draws, and while it can still be put back.
    std::fs::rename(secrets.join("epoch-autumn.json"), scene.file("autumn.key")).unwrap();
    let told = scene.service.wait_for("/readyz", |ready| ready.get("lacks").is_some()).await;
    assert_eq!(told["lacks"][0], "key of epoch autumn");
    scene.restart(None);
    if !crate::support::database::is_postgres() {
        let told = scene.service.said.lock().unwrap().join("\n");
        assert!(told.contains("which are not over") && told.contains("autumn"), "{told}");
    }
    std::fs::rename(scene.file("autumn.key"), secrets.join("epoch-autumn.json")).unwrap();
    scene.service.wait_for("/readyz", |ready| ready["status"] == "ok" && ready.get("lacks").is_none()).await;
    // Another key is as good as none.
    let text = std::fs::read_to_string(secrets.join("epoch-autumn.json")).unwrap();
    let at = text.find("\"key\":\"").unwrap() + 7;
    let flipped = if &text[at..=at] == "0" { "1" } else { "0" };
    std::fs::write(secrets.join("epoch-autumn.json"), format!("{}{flipped}{}", &text[..at], &text[at + 1..])).unwrap();
    let draw = json!({ "run": 1, "nonce": NONCE });
    let refused = scene.post(&lab, &format!("/v1/entries/{entry}/instances"), &draw).await;
    assert_eq!(refused.status, StatusCode::SERVICE_UNAVAILABLE, "{}", refused.text);
    assert_eq!(refused.json()["type"], "urn:plumbline:problem:not-ready", "{}", refused.text);
    let is_told = || {
        let said = scene.service.said.lock().unwrap();
        said.iter().any(|line| line.contains("does not hold the key that the epoch is committed to"))
    };
    scene.service.wait_for("/v1/epochs/autumn", |_| is_told()).await;
    // With the key the draw succeeds: nothing was closed.
    std::fs::write(secrets.join("epoch-autumn.json"), text).unwrap();
    assert_eq!(scene.service.get("/v1/epochs/autumn").await.json()["state"], "open");
    scene.draw(&lab, &entry, 1).await;
    // Where it is lost for good, the operator closes the epoch.
    let closed = run(&["epochs", "close", "autumn", "--reason", "its key was lost"], Some(&scene.file("p.db")));
    assert!(closed.status.success(), "{}", said(&closed));
    scene.is_sealed().await;
    std::fs::remove_file(secrets.join("epoch-autumn.json")).unwrap();
    if crate::support::database::is_postgres() {
        return;
    }
    // Without the file the start says which epochs nobody can verify, and who else may read what is left.
    for (path, mode) in [(secrets.clone(), 0o755), (secrets.join("receipts.key"), 0o644)] {
        std::fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
    }
    scene.restart(None);
    let told = scene.service.said.lock().unwrap().join("\n");
    assert!(told.contains("so nobody can get their reveal") && told.contains("autumn"), "{told}");
    assert!(
        told.contains("others may read or change the secrets") && told.contains("receipts.key has mode 0644"),
        "{told}"
    );
}

#[tokio::test]
async fn a_clock_that_jumps_for_moments_seals_no_epoch() {
    let scene = Scene::new(&["--per-instance", "8"]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 2).await;
    let drawn = scene.draw(&lab, &entry, 2).await;
    let other = scene.register(&lab, "dev", 1).await;
    let others = scene.draw(&lab, &other, 1).await;
    let at = |instance: &Value| format!("/v1/instances/{}/answer", id(instance));
    let episode = id(&scene.made(&lab, "/v1/episodes", &json!({ "instance": id(&drawn[1]) })).await).to_owned();
    // The siblings take seconds, and the jump is believed after a minute.
    let pool = scene.pool();
    // A time server is wrong by a thousand years, for longer than several looks of the service.
    scene.jump_clock(1_000 * 365 * 24 * 3_600_000);
    let said = |text: &str| scene.service.said.lock().unwrap().iter().any(|line| line.contains(text));
    scene.service.wait_for("/v1/epochs/autumn", |_| said("the clock has jumped;")).await;
    tokio::time::sleep(Duration::from_secs(3)).await;
    let refused = scene.service.get("/v1/epochs/autumn/reveal").await;
    assert_eq!(refused.status, StatusCode::CONFLICT, "{}", refused.text);
    // Whoever is too late by such a clock is asked to come again: an agent's client does so by itself.
    let late = scene.post(&lab, &format!("/v1/entries/{entry}/instances"), &json!({ "run": 1, "nonce": NONCE })).await;
    assert_eq!(late.status, StatusCode::SERVICE_UNAVAILABLE, "{}", late.text);
    assert_eq!(late.headers["retry-after"], "60");
    for (path, body) in [
        (format!("/v1/episodes/{episode}/steps"), json!({ "events": [] })),
        (format!("/v1/episodes/{episode}/submit"), json!({})),
    ] {
        let late = scene.post(&lab, &path, &body).await;
        assert_eq!(late.status, StatusCode::SERVICE_UNAVAILABLE, "{path}: {}", late.text);
    }
    // An answer is in time, and dated by the time that is believed.
    scene.made(&lab, &at(&drawn[0]), &answer_to(&drawn[0], &pool, false)).await;
    // One that is behind dates an answer no earlier than its draw, and the end of an entry no earlier than its answers.
    scene.jump_clock(-365 * 24 * 3_600_000);
    scene.made(&lab, &at(&others[0]), &answer_to(&others[0], &pool, false)).await;
    all_are_graded(&scene, 2).await;
    scene.made(&lab, &format!("/v1/entries/{other}/finalize"), &json!({})).await;
    scene.jump_clock(0);
    scene.service.wait_for("/v1/epochs/autumn", |epoch| epoch["state"] == "open" && said("jumped back")).await;
    scene.draw(&lab, &entry, 1).await;
    assert!(said("an epoch is open") && !said("an epoch is settled"));
    // Time that passes settles it, and the log says so.
    scene.set_clock(1_000 * 365 * 24 * 3_600_000);
    scene.is_sealed().await;
    scene.service.wait_for("/v1/epochs/autumn", |_| said("an epoch is settled")).await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.text;
    let verified = verify(&serde_json::from_str(&reveal).unwrap(), &Kept::default()).unwrap();
    assert!(verified.breaches.is_empty(), "{:?}", verified.breaches);
}
