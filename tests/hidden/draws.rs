//! Draws that can be checked at once: the proof is in the response, and holds for nothing else.

use std::collections::BTreeSet;
use std::process::Command;

use crate::support::database;
use crate::support::epoch::{CONFIGURATION, Scene, id, run, said};
use crate::support::repository;
use plumbline::store::db::{Each, query};
use plumbline_engine::hidden::receipts::Signer;
use serde_json::{Value, json};

#[tokio::test]
async fn a_draw_is_checked_before_the_epoch_is_over() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let epoch = scene.service.get("/v1/epochs/autumn").await.json();
    std::fs::write(scene.file("epoch.json"), epoch.to_string()).unwrap();
    let new = json!({ "agent": "a", "configuration_sha256": CONFIGURATION, "tier": "official", "runs": 2 });
    let registered = scene.made(&lab, "/v1/epochs/autumn/entries", &new).await;
    let (entry, entry_receipt) = (id(&registered), &registered["receipt"]);
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
    let without = |member: &str| {
        let mut changed = first.clone();
        changed.as_object_mut().unwrap().remove(member);
        changed
    };
    for (member, value) in [("expires_at", json!("2026-01-01T00:00:00.000Z")), ("run", json!(2))] {
        let mut changed = first.clone();
        changed["instances"][0][member] = value;
        let (ours, _, told) = said_of(&changed, &[]);
        assert!(!ours && told.contains("BROKEN  receipt: "), "{member}: {told}");
    }
    let mut unasked = first.clone();
    unasked["instances"][0]["prompts"] = Value::Null;
    let (ours, _, told) = said_of(&without("receipt"), &[]);
    assert!(!ours && told.contains("BROKEN  receipt: the response has none"), "{told}");
    for (draw, of_receipt) in [
        (&unasked, "NOT CHECKED  receipt: it states these instances, but the file lacks the prompts"),
        (&first, "its receipt states these instances and prompts"),
        (&second, "its receipt states these instances and prompts"),
        (&first["draw"], "NOT CHECKED  receipt: there is none"),
    ] {
        let (ours, theirs, told) = said_of(draw, &["--nonce", nonce]);
        assert!(ours && theirs && told.contains(of_receipt), "{told}");
    }
    // What is asked is signed: other prompts, other instances and another receipt are found by the program.
    let with = |pointer: &str, value: Value| {
        let mut changed = first.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        changed
    };
    for (changed, why) in [
        (with("/instances/0/prompts/0", json!("Build what you like.")), "it states other prompts for instance"),
        (with("/instances/0/id", second["instances"][0]["id"].clone()), "it states other instances"),
        (with("/receipt", second["receipt"].clone()), "it is of another draw"),
        (with("/receipt/receipt/draw/drawn_at_ms", json!(0)), "its signature does not hold"),
        (with("/receipt", entry_receipt.clone()), "it states something else than a draw"),
    ] {
        let (ours, _, told) = said_of(&changed, &[]);
        assert!(!ours && told.contains(&format!("BROKEN  receipt: {why}")), "{told}");
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

/// An operator with the database asks for something else than what was drawn, or draws once more: a lab that kept its
/// draw shows both.
#[tokio::test]
async fn a_draw_that_was_kept_shows_false_prompts_and_other_draws() {
    let scene = Scene::withholding();
    let lab = scene.key("lab");
    let made = run(&["keys", "create", "--name", "operator", "--scopes", "admin"], Some(&scene.file("p.db")));
    let admin = String::from_utf8(made.stdout).unwrap().trim().to_owned();
    let epoch = scene.service.get("/v1/epochs/autumn").await.json();
    std::fs::write(scene.file("epoch.json"), epoch.to_string()).unwrap();
    let entry = scene.register(&lab, "dev", 1).await;
    let path = format!("/v1/entries/{entry}/instances");
    let draw = |nonce: &str| json!({ "run": 1, "nonce": nonce });
    // Nobody draws, answers or finalizes in the place of an entrant.
    for (path, body) in
        [(path.clone(), draw("a nonce of the operator")), (format!("/v1/entries/{entry}/finalize"), json!({}))]
    {
        let refused = scene.post(&admin, &path, &body).await;
        assert_eq!(refused.status.as_u16(), 403, "{}", refused.text);
    }
    let kept = scene.made(&lab, &path, &draw("a nonce of our own")).await;
    let at = json!({ "instance": kept["instances"][1]["id"] });
    assert_eq!(scene.post(&admin, "/v1/episodes", &at).await.status.as_u16(), 403);
    let episode = id(&scene.made(&lab, "/v1/episodes", &at).await).to_owned();
    for action in ["steps", "next-turn", "submit"] {
        let refused = scene.post(&admin, &format!("/v1/episodes/{episode}/{action}"), &json!({ "events": [] })).await;
        assert_eq!(refused.status.as_u16(), 403, "{action}: {}", refused.text);
    }
    let answered = scene.post(&admin, &format!("/v1/instances/{}/answer", id(&kept["instances"][0])), &json!({})).await;
    assert_eq!(answered.status.as_u16(), 403, "{}", answered.text);

    let check = |name: &str, draw: &Value| {
        std::fs::write(scene.file(name), draw.to_string()).unwrap();
        let [draw, epoch] = [name, "epoch.json"].map(|name| scene.file(name).to_str().unwrap().to_owned());
        said(&run(&["verify-draw", &draw, "--commitment", &epoch], None))
    };
    assert!(check("kept.json", &kept).contains("its receipt states these instances and prompts"));
    let forger = Signer::new(&[9; 32]);
    let mut forged = kept.clone();
    forged["receipt"]["signature"] = json!(forger.sign(&kept["receipt"]["receipt"]).signature);
    forged["receipt"]["public_key"] = json!(forger.public_key());
    assert!(check("forged.json", &forged).contains("BROKEN  receipt: it is signed with"), "a key of somebody else");
    let pool = database::pool(&scene.file("p.db")).await;
    let change = async |sql: String| {
        let changed = query(sqlx::AssertSqlSafe(sql.clone())).execute(&pool).await.unwrap();
        assert!(changed > 0, "{sql}");
    };
    change("UPDATE tasks SET body = replace(body, '\"prompt\":\"', '\"prompt\":\"Do not ')".to_owned()).await;
    let asked = scene.made(&lab, &path, &draw("a nonce of our own")).await;
    let told = check("asked.json", &asked);
    assert!(told.contains("BROKEN  receipt: it states other prompts for instance"), "{told}");
    change("UPDATE tasks SET body = replace(body, '\"prompt\":\"Do not ', '\"prompt\":\"')".to_owned()).await;

    // The draw is forgotten before anything of it is published.
    change("DELETE FROM pending_receipts WHERE body LIKE '%\"draw\":{%'".to_owned()).await;
    change(format!("DELETE FROM episodes WHERE id = '{episode}'")).await;
    change(format!("DELETE FROM instances WHERE entry_id = '{entry}'")).await;
    pool.close().await;
    let again = scene.made(&lab, &path, &draw("another nonce of ours")).await;
    assert!(check("again.json", &again).contains("its receipt states these instances and prompts"));
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.refused(&lab, "/v1/episodes", &json!({ "instance": again["instances"][0]["id"] }), "finalized").await;
    // An end that comes early is no breach, and is said.
    let closed = run(&["epochs", "close", "autumn", "--reason", "the suite changed"], Some(&scene.file("p.db")));
    assert!(closed.status.success(), "{}", said(&closed));
    scene.is_sealed().await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.json();
    std::fs::write(scene.file("reveal.json"), reveal.to_string()).unwrap();
    let kept_draw = kept;
    let [reveal, epoch, kept, again] = ["reveal.json", "epoch.json", "kept.json", "again.json"]
        .map(|name| scene.file(name).to_str().unwrap().to_owned());
    let with = |given: &str| said(&run(&["verify-epoch", &reveal, "--commitment", &epoch, "--given", given], None));
    let told = with(&kept);
    assert!(told.contains(&format!("(the draw of run 1 of entry {entry}): is missing from the reveal")), "{told}");
    let mut asked = asked;
    asked["receipt"] =
        serde_json::from_slice::<Value>(&std::fs::read(scene.file("again.json")).unwrap()).unwrap()["receipt"].clone();
    std::fs::write(scene.file("asked.json"), asked.to_string()).unwrap();
    let told = with(scene.file("asked.json").to_str().unwrap());
    assert!(told.contains("BROKEN  receipt in ") && told.contains("it states other instances"), "{told}");
    // A receipt of another epoch says nothing of this one, whose rules are not its own.
    let mut other = kept_draw;
    other["receipt"]["receipt"]["epoch"] = json!("winter");
    other["instances"][0]["expires_at"] = json!("2001-01-01T00:00:00.000Z");
    std::fs::write(scene.file("other.json"), other.to_string()).unwrap();
    let told = with(scene.file("other.json").to_str().unwrap());
    assert!(told.contains("belongs to another epoch") && !told.contains("BROKEN"), "{told}");
    let told = with(&again);
    assert!(!told.contains("BROKEN") && told.contains("NOTE  the epoch ended "), "{told}");
    assert!(told.contains("before its committed end, with the reason \"the suite changed\""), "{told}");
    what_the_log_lost_is_damage(&scene).await;
}

/// `check` compares the log with the receipts that were handed out, and an epoch with its announcement.
async fn what_the_log_lost_is_damage(scene: &Scene) {
    let check = || run(&["check"], Some(&scene.file("p.db")));
    assert!(check().status.success(), "{}", said(&check()));
    let pool = database::pool(&scene.file("p.db")).await;
    let allow = Each { sqlite: "DROP TRIGGER receipts_stay", postgres: "DROP TRIGGER receipts_stay ON receipts" };
    query(allow).execute(&pool).await.unwrap();
    for damage in [
        "DELETE FROM receipts WHERE epoch_id IS NOT NULL",
        "UPDATE epochs SET commitment = replace(commitment, '\"opens_at_ms\":', '\"opens_at_ms\":1')",
        "INSERT INTO cosignatures (witness, size, checkpoint, line, at_s) VALUES ('w', 999999, '', '', 1)",
    ] {
        query(damage).execute(&pool).await.unwrap();
    }
    pool.close().await;
    let told = said(&check());
    for part in [
        "its receipt is missing from the log",
        "DAMAGED  epochs autumn: its commitment is not the one that the log announces",
        "DAMAGED  cosignatures w: it is of 999999 receipts, and the log has ",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
}

/// A configuration stays with the owner who first entered it, in whatever epoch and tier.
#[tokio::test]
async fn a_configuration_has_one_owner_over_all_epochs() {
    let scene = Scene::new(&[]);
    let (lab, rival) = (scene.key("lab"), scene.key("rival"));
    let made = run(
        &["epochs", "create", "winter", "--closes", "2100-01-01", "--per-instance", "3"],
        Some(&scene.file("p.db")),
    );
    assert!(made.status.success() && !said(&made).contains("whole budget"), "{}", said(&made));
    let rules = ["--owner-percent", "50", "--budget-bits", "100", "--dev-feedback", "criteria", "--no-siblings"];
    let create = ["epochs", "create", "spring", "--closes", "2100-01-01", "--per-instance", "4"];
    let made = run(&[&create[..], &rules].concat(), Some(&scene.file("p.db")));
    assert!(said(&made).contains("one owner can spend the whole budget of 100 bits"), "{}", said(&made));
    let new = |configuration: &str, tier: &str| json!({ "agent": "a", "configuration_sha256": configuration, "tier": tier, "runs": 1 });
    let (autumn, winter) = ("/v1/epochs/autumn/entries", "/v1/epochs/winter/entries");
    scene.made(&lab, autumn, &new(CONFIGURATION, "official")).await;
    scene.refused(&rival, winter, &new(CONFIGURATION, "official"), "configuration-taken").await;
    scene.made(&lab, winter, &new(CONFIGURATION, "official")).await;
    let other = "0".repeat(64);
    scene.made(&rival, autumn, &new(&other, "dev")).await;
    let third = scene.key("third");
    scene.refused(&third, autumn, &new(&other, "official"), "configuration-taken").await;
    scene.refused(&third, winter, &new(&other, "official"), "configuration-taken").await;
    scene.made(&rival, winter, &new(&other, "official")).await;
}
