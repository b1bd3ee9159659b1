//! Draws that can be checked at once: the proof is in the response, and holds for nothing else.

use std::collections::BTreeSet;
use std::process::Command;

use crate::support::epoch::{Scene, run, said};
use crate::support::repository;
use serde_json::{Value, json};

#[tokio::test]
async fn a_draw_is_checked_before_the_epoch_is_over() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let epoch = scene.service.get("/v1/epochs/autumn").await.json();
    std::fs::write(scene.file("epoch.json"), epoch.to_string()).unwrap();
    let entry = scene.register(&lab, "official", 2).await;
    let path = format!("/v1/entries/{entry}/instances");
    let nonce = "eine Nonce, \"quoted\" и своя 🎲";
    let first = scene.made(&lab, &path, &json!({ "run": 1, "nonce": nonce })).await;
    let again = scene.made(&lab, &path, &json!({ "run": 1, "nonce": nonce })).await;
    assert_eq!(first, again, "a draw that is repeated has the same proof");
    let second = scene.made(&lab, &path, &json!({ "run": 2, "nonce": nonce })).await;
    assert_ne!(first["draw"]["output"], second["draw"]["output"], "each run has an output of its own");

    let said_of = |draw: &Value, more: &[&str]| {
        std::fs::write(scene.file("draw.json"), draw.to_string()).unwrap();
        let [draw, epoch] = ["draw.json", "epoch.json"].map(|name| scene.file(name).to_str().unwrap().to_owned());
        let checked = run(&[&["verify-draw", &draw, "--commitment", &epoch], more].concat(), None);
        let script = repository("examples/verify_draw.py");
        let by_python = Command::new("python3").arg(script).args([&draw, &epoch]).output().unwrap();
        (checked.status.success(), by_python.status.success(), said(&checked) + &said(&by_python))
    };
    for draw in [&first, &second, &first["draw"]] {
        let (ours, theirs, told) = said_of(draw, &["--nonce", nonce]);
        assert!(ours && theirs, "{told}");
    }
    // Whatever is changed, and the draw of another run: found by the program and by the script.
    let exchanged = |member: &str, value: Value| {
        let mut changed = first.clone();
        changed["draw"][member] = value;
        changed
    };
    let proof = first["draw"]["proof"].as_str().unwrap();
    let changed: Vec<Value> = vec![
        exchanged("entry", json!("0198c0de-0000-7000-8000-000000000000")),
        exchanged("run", json!(2)),
        exchanged("nonce", json!("another")),
        exchanged("proof", second["draw"]["proof"].clone()),
        exchanged("output", second["draw"]["output"].clone()),
        exchanged("proof", json!(format!("{}{}", &proof[..158], if proof.ends_with("00") { "01" } else { "00" }))),
    ];
    for draw in &changed {
        let (ours, theirs, told) = said_of(draw, &[]);
        assert!(!ours && !theirs, "{draw}: {told}");
    }
    let (ours, _, told) = said_of(&first, &["--nonce", "the one that I sent"]);
    assert!(!ours && told.contains("BROKEN  nonce"), "{told}");

    // The receipts of the draws hold the same proofs.
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.end_epoch().await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.json();
    let facts = reveal["receipts"].as_array().unwrap().iter().filter_map(|file| file["receipt"].get("draw"));
    // Receipts of one batch have no order.
    let proofs: BTreeSet<&str> = facts.filter_map(|fact| fact["proof"].as_str()).collect();
    assert_eq!(proofs, [&first, &second].map(|own| own["draw"]["proof"].as_str().unwrap()).into());
    std::fs::write(scene.file("reveal.json"), reveal.to_string()).unwrap();
    let [reveal, epoch] = ["reveal.json", "epoch.json"].map(|name| scene.file(name).to_str().unwrap().to_owned());
    let verified = run(&["verify-epoch", &reveal, "--commitment", &epoch], None);
    assert!(verified.status.success(), "{}", said(&verified));
}
