//! What entrants and operators try against hidden evaluation: more than their share, grades after the reveal, clocks
//! set back, and reveals that say what did not happen.

use std::collections::{BTreeMap, BTreeSet};

use crate::support::database::is_postgres;
use crate::support::epoch::{CONFIGURATION, Scene, all_are_graded, answer_to, appended, id, run, said};
use crate::support::tampering::{forged_with_other_prompts, forged_without_the_last_entry, tamperings};
use plumbline_engine::hidden::reveal::Reveal;
use plumbline_engine::hidden::verify::{Kept, Verified, verify};
use plumbline_engine::voxel::BlockLog;
use reqwest::StatusCode;
use serde_json::{Value, json};

const HOUR_MS: i64 = 3_600_000;
const OTHER_CONFIGURATION: &str = "2c26b46b68ffc68ff99b453c1d30413413422d706483bfa0f98a5e886266e7ae";

async fn becomes(scene: &Scene, path: &str, wanted: &str) {
    scene.service.wait_for(path, |found| found["state"] == wanted).await;
}

/// Everything that can be downloaded of an epoch that is over, and what an entrant kept.
struct Downloaded {
    reveal: Value,
    logs: BTreeMap<String, BlockLog>,
    pages: Vec<Value>,
    boards: Vec<Value>,
    given: Vec<Value>,
}

impl Downloaded {
    fn kept(&self) -> Kept {
        let page =
            |page: &Value| serde_json::from_value::<plumbline_engine::hidden::receipts::LogPage>(page.clone()).unwrap();
        let pages: Vec<_> = self.pages.iter().map(page).collect();
        Kept {
            commitment: Some(serde_json::from_value(self.reveal["commitment"].clone()).unwrap()),
            logs: Some(self.logs.clone()),
            heads: pages.iter().filter_map(|page| page.head.clone()).collect(),
            log: pages.into_iter().flat_map(|page| page.receipts).collect(),
            given: self.given.iter().map(|given| serde_json::from_value(given.clone()).unwrap()).collect(),
            boards: self.boards.clone(),
            boards_follow_reveal: true,
            keys: Vec::new(),
            pool: serde_json::from_value(self.reveal["pool"].clone()).unwrap(),
        }
    }

    fn verified(&self, reveal: &Value) -> Verified {
        let reveal: Reveal = serde_json::from_value(reveal.clone()).unwrap();
        verify(&reveal, &self.kept()).unwrap()
    }
}

/// Two labs in both tiers; one instance is not answered, and some answers fail.
async fn an_epoch() -> (Scene, Downloaded) {
    let scene = Scene::new(&[]);
    let (lab, other) = (scene.key("lab"), scene.key("other"));
    let mut given = Vec::new();
    for (key, tier, configuration, spoiled) in [
        (&lab, "official", CONFIGURATION, 4),
        (&other, "official", OTHER_CONFIGURATION, 9),
        (&other, "dev", CONFIGURATION, 2),
    ] {
        let new =
            json!({ "agent": format!("agent {tier}"), "configuration_sha256": configuration, "tier": tier, "runs": 1 });
        let entry = scene.made(key, "/v1/epochs/autumn/entries", &new).await;
        given.push(entry["receipt"].clone());
        let drawn = scene.draw(key, id(&entry), 1).await;
        let pool = scene.pool();
        for (i, instance) in drawn.iter().enumerate().skip(usize::from(tier == "dev")) {
            let body = answer_to(instance, &pool, i < spoiled);
            let taken = scene.made(key, &format!("/v1/instances/{}/answer", id(instance)), &body).await;
            given.push(taken["receipt"].clone());
        }
        scene.made(key, &format!("/v1/entries/{}/finalize", id(&entry)), &json!({})).await;
        becomes(&scene, &format!("/v1/entries/{}", id(&entry)), "complete").await;
    }
    scene.end_epoch().await;
    let get = async |path: &str| scene.service.get(path).await;
    let reveal = get("/v1/epochs/autumn/reveal").await.json();
    let answers = get("/v1/epochs/autumn/answers").await.text;
    let logs = answers.lines().map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        let log = BlockLog::from_canonical_json(line["log"].to_string().as_bytes()).unwrap();
        (line["instance"].as_str().unwrap().to_owned(), log)
    });
    let logs = logs.collect();
    let pages = vec![get("/v1/receipts?limit=1000").await.json()];
    let boards = vec![
        get("/v1/epochs/autumn/leaderboard").await.json(),
        get("/v1/epochs/autumn/leaderboard?tier=dev").await.json(),
    ];
    (scene, Downloaded { reveal, logs, pages, boards, given })
}

#[tokio::test]
async fn every_tampering_with_a_reveal_is_found() {
    let (scene, downloaded) = an_epoch().await;
    let good = downloaded.verified(&downloaded.reveal);
    assert_eq!((good.breaches.as_slice(), good.unchecked.as_slice()), (&[][..], &[][..]));
    assert_eq!((good.grades, good.boards), (77, 2));
    // 3 entries, 3 draws, 77 answers with a place each for a grade, 3 ends with as many places again, and the end of
    // all.
    assert_eq!(good.receipts, 241);
    if is_postgres() {
        // What follows reads documents alone, whichever database the epoch was in.
        return;
    }
    for (name, changed) in tamperings(&downloaded.reveal) {
        let Ok(reveal) = serde_json::from_value::<Reveal>(changed) else { continue };
        let found = verify(&reveal, &downloaded.kept()).unwrap();
        assert!(!found.breaches.is_empty(), "not found: {name}");
        // The reveal alone shows it too, without the log, the boards and what entrants kept; but for what it promised
        // before, and places in a log that nobody has.
        let alone = Kept { logs: Some(downloaded.logs.clone()), ..Kept::default() };
        let is_outside =
            ["rules", "the closing"].iter().any(|own| name.starts_with(own)) || name.ends_with("in another place");
        assert!(is_outside || !verify(&reveal, &alone).unwrap().breaches.is_empty(), "not found alone: {name}");
    }

    // The operator, who has the key, signs everything anew without the last entry: the log that was kept and the
    // receipts that were given out are then the only witnesses, and each of them is enough.
    let reveal = serde_json::from_value(forged_without_the_last_entry(&scene, &downloaded.reveal)).unwrap();
    let found = |kept: Kept| verify(&reveal, &kept).unwrap().breaches;
    let base = Kept::default;
    assert_eq!(found(base()), [], "nothing but what others kept can show this");
    let all = downloaded.kept();
    assert!(!found(Kept { given: all.given, ..base() }).is_empty(), "what entrants were given");
    assert!(!found(Kept { log: all.log, heads: all.heads, ..base() }).is_empty(), "the log");
    assert!(!found(Kept { boards: all.boards, ..base() }).is_empty(), "the boards");
    // Prompts follow from the key, so false ones show from the reveal alone.
    let told = ["asked something else", "has 0 prompts for"];
    for (other, told) in forged_with_other_prompts(&scene, &downloaded.reveal).into_iter().zip(told) {
        let breaches = verify(&serde_json::from_value(other).unwrap(), &base()).unwrap().breaches;
        assert!(breaches.iter().any(|breach| breach.detail.contains(told)), "{told}: {breaches:?}");
    }
    the_log_is_not_believed_for_being_long(&reveal, &downloaded);
    the_command_says_the_same(&scene, &downloaded);
}

/// A log whose new receipts are withheld, or that says that the key has changed, proves nothing by itself.
fn the_log_is_not_believed_for_being_long(forged: &Reveal, downloaded: &Downloaded) {
    use plumbline_engine::hidden::receipts::{LogHead, LogPage, Signer, key_change};
    // The kept pages, with bodies that the operator no longer shows, but for announcements, which are public at once.
    let mut kept = downloaded.kept();
    for file in kept.log.iter_mut().filter(|file| !file.receipt.as_ref().unwrap()["epoch"].is_object()) {
        (file.receipt, file.signature) = (None, None);
    }
    (kept.given, kept.boards) = (Vec::new(), Vec::new());
    let good: Reveal = serde_json::from_value(downloaded.reveal.clone()).unwrap();
    assert!(verify(&good, &kept).unwrap().breaches.is_empty());
    let found = verify(forged, &kept).unwrap();
    assert!(!found.breaches.is_empty() || !found.unchecked.is_empty(), "nothing tells that bodies are withheld");
    // Without rules in the commitment nothing would be asked; what entrants hold is asked all the same.
    let mut without = downloaded.reveal.clone();
    without["commitment"].as_object_mut().unwrap().remove("rules");
    without["receipts"] = serde_json::json!([]);
    let given = Kept { given: downloaded.kept().given, ..Kept::default() };
    let found = verify(&serde_json::from_value(without).unwrap(), &given).unwrap();
    assert!(found.breaches.iter().any(|breach| breach.detail == "is missing from the reveal"), "{:?}", found.breaches);
    // Somebody without the key continues the log with a change to a key of their own.
    let page: LogPage = serde_json::from_value(downloaded.pages[0].clone()).unwrap();
    let (own, last) = (Signer::new(&[9; 32]), page.receipts.last().unwrap().clone());
    let file = appended(&last, key_change(&last.public_key, &own.public_key(), 7), &own);
    let mut kept = downloaded.kept();
    kept.heads = vec![LogHead::signed(file.seq, file.link.clone(), 8, &own)];
    kept.log.push(file);
    let found = verify(&good, &kept).unwrap();
    assert!(found.breaches.iter().any(|breach| breach.detail.contains("signed with the key")), "{:?}", found.breaches);
}

/// The command, with everything that can be given to it.
fn the_command_says_the_same(scene: &Scene, downloaded: &Downloaded) {
    let write = |name: &str, text: String| {
        std::fs::write(scene.file(name), text).unwrap();
        scene.file(name).to_str().unwrap().to_owned()
    };
    let reveal = write("reveal.json", downloaded.reveal.to_string());
    let answers = downloaded.logs.iter().map(|(id, log)| {
        format!("{{\"instance\":\"{id}\",\"log\":{}}}\n", String::from_utf8(log.canonical_json()).unwrap())
    });
    let answers = write("answers.ndjson", answers.collect());
    let log = write("log.json", downloaded.pages[0].to_string());
    let given = write(
        "given.json",
        downloaded.given.iter().map(|given| json!({ "receipt": given }).to_string() + "\n").collect(),
    );
    let board = write("board.json", downloaded.boards[0].to_string());
    let arguments =
        ["verify-epoch", &reveal, "--answers", &answers, "--receipts", &log, "--given", &given, "--board", &board];
    let checked = run(&arguments, None);
    assert!(checked.status.success(), "{}", said(&checked));
    assert!(said(&checked).contains("241 receipts agree with the reveal; 1 board recomputed"), "{}", said(&checked));
    assert!(said(&checked).contains("NOT CHECKED  commitment"), "{}", said(&checked));
    // A log whose tail is cut, or whose places are changed, is no log.
    let key = downloaded.reveal["commitment"]["rules"]["receipt_key"].as_str().unwrap();
    let cut = |change: &dyn Fn(&mut Value)| {
        let mut page = downloaded.pages[0].clone();
        change(&mut page);
        let page = write("cut.json", page.to_string());
        run(&["verify-receipt", &page, "--key", key], None)
    };
    assert!(cut(&|_| {}).status.success());
    for change in [
        &(|page: &mut Value| drop(page["receipts"].as_array_mut().unwrap().pop())) as &dyn Fn(&mut Value),
        &|page: &mut Value| page["head"] = Value::Null,
        &|page: &mut Value| {
            for receipt in page["receipts"].as_array_mut().unwrap() {
                receipt["seq"] = (receipt["seq"].as_i64().unwrap() + 1).into();
            }
        },
    ] {
        let bad = cut(change);
        assert_eq!(bad.status.code(), Some(1), "{}", said(&bad));
    }
}

#[tokio::test]
async fn one_owner_cannot_use_up_an_epoch_and_reservations_end() {
    let scene = Scene::new(&["--per-instance", "4", "--owner-percent", "50", "--reservation-seconds", "600"]);
    let [lab, other, third] = ["lab", "other", "third"].map(|name| scene.key(name));
    let entries = "/v1/epochs/autumn/entries";
    let new = |configuration: &str, tier: &str, runs: u32| json!({ "agent": "a", "configuration_sha256": configuration, "tier": tier, "runs": runs });
    let mine = scene.register(&lab, "official", 2).await;
    scene.refused(&lab, entries, &new(CONFIGURATION, "dev", 1), "share-used-up").await;
    // The same agent under another name has no further official attempts.
    scene.refused(&other, entries, &new(CONFIGURATION, "official", 1), "configuration-taken").await;
    let theirs = scene.made(&other, entries, &new(OTHER_CONFIGURATION, "official", 2)).await;
    scene.refused(&third, entries, &new(CONFIGURATION, "dev", 1), "pool-used-up").await;
    // One run is drawn in time; what was reserved and not drawn is free again after a while.
    scene.draw(&lab, &mine, 1).await;
    scene.set_clock(601_000);
    let late = scene.made(&third, entries, &new(CONFIGURATION, "dev", 2)).await;
    // Whoever enters a configuration later, in whatever tier, has not taken it from the first.
    scene.refused(&third, entries, &new(CONFIGURATION, "official", 1), "share-used-up").await;
    scene.draw(&lab, &mine, 2).await;
    let draw = json!({ "run": 1, "nonce": "a nonce of our own 1" });
    scene.refused(&other, &format!("/v1/entries/{}/instances", id(&theirs)), &draw, "pool-used-up").await;
    scene.draw(&third, id(&late), 1).await;
    scene.draw(&third, id(&late), 2).await;
}

#[tokio::test]
async fn what_is_over_stays_over_whatever_the_clock_says() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.set_clock(2 * HOUR_MS);
    becomes(&scene, &format!("/v1/entries/{entry}"), "complete").await;
    scene.set_clock(0);
    assert_eq!(scene.service.get("/v1/epochs/autumn").await.json()["state"], "closed");
    let new = json!({ "agent": "a", "configuration_sha256": CONFIGURATION, "tier": "dev", "runs": 1 });
    scene.refused(&lab, "/v1/epochs/autumn/entries", &new, "epoch-not-open").await;
    let body = answer_to(&drawn[0], &scene.pool(), false);
    scene.refused(&lab, &format!("/v1/instances/{}/answer", id(&drawn[0])), &body, "epoch-not-open").await;
    assert_eq!(scene.service.get("/v1/epochs/autumn/reveal").await.status, StatusCode::OK);
}

/// An answer that a failure of ours left without a grade may be sent again, but not once the entry is complete: what
/// was revealed stays.
#[tokio::test]
async fn nothing_is_graded_after_the_reveal() {
    // A receipt that is in the log by then would tell of the grade that the test takes away.
    let mut scene = Scene::withholding();
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "official", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &drawn[..2], 0).await;
    all_are_graded(&scene, 2).await;
    // The failure, as the store would record it: there is no way to make the grader fail from outside.
    let database = crate::support::database::pool(&scene.file("p.db")).await;
    for statement in [
        "DELETE FROM reports WHERE submission_id = (SELECT MIN(submission_id) FROM reports)",
        "DELETE FROM pending_receipts WHERE submission_id IS NOT NULL AND submission_id NOT IN (SELECT submission_id FROM reports)",
        "UPDATE submissions SET state = 'grader_error' WHERE id NOT IN (SELECT submission_id FROM reports)",
    ] {
        plumbline::store::db::query(statement).execute(&database).await.unwrap();
    }
    scene.publish_every = 1;
    scene.restart(None);
    scene.set_clock(2 * HOUR_MS);
    becomes(&scene, &format!("/v1/entries/{entry}"), "complete").await;
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await;
    let pool = scene.pool();
    for instance in &drawn[..2] {
        let path = format!("/v1/instances/{}/answer", id(instance));
        let again = scene.post(&lab, &path, &answer_to(instance, &pool, false)).await;
        assert!(again.status == StatusCode::CONFLICT || again.json()["repeated"] == true, "{}", again.text);
    }
    tokio::time::sleep(std::time::Duration::from_millis(1_500)).await;
    assert_eq!(scene.service.get("/v1/epochs/autumn/reveal").await.text, reveal.text);
    // A failure that no receipt explains is a breach.
    let found = verify(&serde_json::from_str(&reveal.text).unwrap(), &Kept::default()).unwrap();
    assert!(found.breaches.iter().any(|own| own.detail.contains("no receipt of a failure")), "{:?}", found.breaches);
    let unsettled: i64 =
        plumbline::store::db::query_scalar("SELECT COUNT(*) FROM jobs").fetch_one(&database).await.unwrap();
    assert_eq!(unsettled, 0);
}

/// The key that signs receipts is lost while receipts wait: they come into the log before the change, and the log
/// holds.
#[tokio::test]
async fn a_lost_receipt_key_breaks_no_log() {
    let mut scene = Scene::withholding();
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let first = scene.service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].clone();
    std::fs::remove_file(scene.file("p.db.secrets/receipts.key")).unwrap();
    scene.options = vec!["--new-receipt-key".to_owned()];
    scene.restart(None);
    let drawn = scene.draw(&lab, &entry, 1).await;
    scene.answer(&lab, &drawn[..2], 0).await;
    scene.set_clock(2 * HOUR_MS);
    becomes(&scene, &format!("/v1/entries/{entry}"), "complete").await;
    let page = scene.service.get("/v1/receipts?limit=1000").await;
    let second = scene.service.get("/.well-known/plumbline-receipts.json").await.json()["public_key"].clone();
    let (first, second) = (first.as_str().unwrap(), second.as_str().unwrap());
    assert_ne!(first, second);
    std::fs::write(scene.file("log.json"), &page.text).unwrap();
    let log = scene.file("log.json").to_str().unwrap().to_owned();
    let checked = run(&["verify-receipt", &log, "--key", first, "--key", second], None);
    assert!(checked.status.success() && said(&checked).contains("the key changed"), "{}", said(&checked));
    let reveal = scene.service.get("/v1/epochs/autumn/reveal").await.text;
    std::fs::write(scene.file("reveal.json"), reveal).unwrap();
    let reveal = scene.file("reveal.json").to_str().unwrap().to_owned();
    let told = run(&["verify-epoch", &reveal, "--receipts", &log, "--key", second], None);
    assert!(told.status.success(), "{}", said(&told));
    let untold = run(&["verify-epoch", &reveal, "--receipts", &log], None);
    assert_eq!(
        untold.status.code(),
        Some(1),
        "another key is trusted only where whoever verifies says so: {}",
        said(&untold)
    );
}

#[tokio::test]
async fn a_promise_comes_with_the_first_answer() {
    let scene = Scene::new(&[]);
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let path = format!("/v1/instances/{}/answer", id(&drawn[0]));
    let mut body = answer_to(&drawn[0], &scene.pool(), false);
    let first = scene.made(&lab, &path, &body).await;
    assert_eq!(first["receipt"]["receipt"]["answer"]["instance"], drawn[0]["id"]);
    let again = scene.made(&lab, &path, &body).await;
    assert_eq!((&again["repeated"], &again["receipt"]), (&json!(true), &first["receipt"]));
    body["transcript_sha256"] = CONFIGURATION.into();
    scene.refused(&lab, &path, &body, "another-transcript").await;
}

/// What everybody can see while answers are graded: the log of receipts, metrics, and where others are in the queue.
#[tokio::test]
async fn nobody_sees_when_a_hidden_answer_is_graded() {
    let mut scene = Scene::withholding();
    let lab = scene.key("lab");
    let entry = scene.register(&lab, "dev", 1).await;
    let drawn = scene.draw(&lab, &entry, 1).await;
    let seen = async |scene: &Scene| {
        let log = scene.service.get("/v1/receipts").await.json();
        let metrics = scene.service.get("/metrics").await.text;
        let told = |line: &&str| {
            ["graded", "grading", "grader", "workers", "not_ended"].iter().any(|word| line.contains(word))
                && !line.starts_with('#')
        };
        (
            log["receipts"].clone(),
            log["head"]["size"].clone(),
            metrics.lines().filter(told).map(str::to_owned).collect::<BTreeSet<_>>(),
        )
    };
    let before = seen(&scene).await;
    scene.answer(&lab, &drawn, 3).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    all_are_graded(&scene, 26).await;
    assert_eq!(seen(&scene).await, before);
    assert_eq!(scene.service.get(&format!("/v1/entries/{entry}")).await.json()["state"], "finalized");
    // At the fixed time all of it is told at once.
    scene.publish_every = 1;
    scene.restart(None);
    becomes(&scene, &format!("/v1/entries/{entry}"), "complete").await;
}
