//! The archive of an epoch: one file that is verified without the service.

use std::io::{Read as _, Write as _};
use std::process::Output;

use crate::support::commands::{refused, succeeded};
use crate::support::database::is_postgres;
use crate::support::epoch::{Scene, run};
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::hidden::tlog::note::{origin, verifier_key};
use serde_json::{Value, json};

/// A change of an archive.
type Change = (&'static str, fn(&mut Value));

fn unpacked(scene: &Scene) -> Value {
    let mut text = String::new();
    GzDecoder::new(std::fs::File::open(scene.file("autumn.archive")).unwrap()).read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn pack(scene: &Scene, name: &str, archive: &Value) -> String {
    let mut packed = GzEncoder::new(std::fs::File::create(scene.file(name)).unwrap(), flate2::Compression::fast());
    packed.write_all(archive.to_string().as_bytes()).unwrap();
    packed.finish().unwrap();
    scene.file(name).to_str().unwrap().to_owned()
}

/// Writes a file beside the database, and returns its path.
fn written(scene: &Scene, name: &str, text: &str) -> String {
    std::fs::write(scene.file(name), text).unwrap();
    scene.file(name).to_str().unwrap().to_owned()
}

/// Changes of the page of the epoch, which nobody signs, each of another member.
const CHANGES_OF_THE_PAGE: [Change; 15] = [
    ("released bits on the page", |it| it["epoch"]["released_bits"] = json!(500.0)),
    ("feedback on the page", |it| it["epoch"]["feedback"]["official"] = json!("full")),
    ("the announcement on the page", |it| it["epoch"]["committed_at"] = json!("2026-01-01T00:00:00.000Z")),
    ("the end on the page", |it| it["epoch"]["closes_at"] = json!("2026-01-01T00:00:00.000Z")),
    ("the opening on the page", |it| it["epoch"]["opens_at"] = json!("2026-01-01T00:00:00.000Z")),
    ("the state on the page", |it| it["epoch"]["state"] = json!("open")),
    ("an early end on the page", |it| it["epoch"]["closed_early_at"] = json!("2026-01-01T00:00:00.000Z")),
    ("instances on the page", |it| it["epoch"]["issued"] = json!(999)),
    ("answers on the page", |it| it["epoch"]["answered"] = json!(999)),
    ("a limit on the page", |it| it["epoch"]["official_entries_per_owner"] = json!(99)),
    ("the time for answers on the page", |it| it["epoch"]["instance_seconds"] = json!(1)),
    ("the budget on the page", |it| it["epoch"]["budget_bits"] = json!(1)),
    ("a reason on the page", |it| it["epoch"]["closed_reason"] = json!("aliens")),
    ("entries on the page", |it| it["epoch"]["entries"]["official"] = json!(9)),
    ("the commitment on the page", |it| it["epoch"]["commitment"]["owner_percent"] = json!(99)),
];

/// Changes of what the archive says of the log and of its witnesses, which nobody signs either.
const CHANGES_OF_THE_LOG: [Change; 6] = [
    ("the key of the log", |it| it["log_key"] = json!(another_key())),
    ("the name of a witness", |it| it["witnesses"]["witnesses"][0]["name"] = json!("famous.example")),
    ("the key of a witness", |it| it["witnesses"]["witnesses"][0]["key"] = json!("w.example+00000000+AAAA")),
    ("what a witness has seen", |it| it["witnesses"]["witnesses"][0]["size"] = json!(3)),
    ("when a witness saw it", |it| {
        it["witnesses"]["witnesses"][0]["cosigned_at"] = json!("2026-01-01T00:00:00.000Z");
    }),
    ("a witness that saw nothing", |it| {
        let told =
            json!({ "name": "v.example", "key": it["log_key"], "size": null, "cosigned_at": null, "note": null });
        it["witnesses"]["witnesses"].as_array_mut().unwrap().push(told);
    }),
];

/// The key of a log of somebody else.
fn another_key() -> String {
    let signer = Signer::new(&[7; 32]);
    verifier_key(&origin(&signer.public_key()), &signer)
}

#[tokio::test]
async fn an_epoch_is_verified_from_one_file() {
    let mut scene = Scene::new(&["--per-instance", "1"]);
    let lab = scene.key("lab");
    let (url, out) = (scene.service.url.clone(), scene.file("autumn.archive").to_str().unwrap().to_owned());
    let early = run(&["archive-epoch", &url, "autumn", "--out", &out], None);
    assert!(refused(&early).contains("epoch-not-over") && !scene.file("autumn.archive").exists());
    let log_key = scene.service.get("/log/key").await.text;
    let state = scene.file("seen.json").to_str().unwrap().to_owned();
    let witness = |url: &str, more: &[&str]| {
        let arguments = ["witness", url, "--state", &state, "--log-key", &log_key, "--name", "w.example"];
        run(&[&arguments[..], more].concat(), None)
    };
    let first = witness(&url, &[]);
    let early_note = String::from_utf8(first.stdout).unwrap();
    let told = String::from_utf8(first.stderr).unwrap();
    let key = told.lines().find_map(|line| line.strip_prefix("cosigned as ")).unwrap().to_owned();
    scene.options = vec!["--witness".to_owned(), key.clone()];
    scene.restart(None);

    std::fs::write(scene.file("kept.json"), scene.service.get("/v1/epochs/autumn").await.text).unwrap();
    let entry = scene.register(&lab, "official", 1).await;
    let instances = scene.draw(&lab, &entry, 1).await;
    let draw = json!({ "run": 1, "nonce": "a nonce of our own 1" });
    let drawn = scene.made(&lab, &format!("/v1/entries/{entry}/instances"), &draw).await;
    scene.answer(&lab, &instances, 2).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.end_epoch().await;
    let hasty = scene.file("hasty.archive").to_str().unwrap().to_owned();
    let told = succeeded(&run(&["archive-epoch", &scene.service.url, "autumn", "--out", &hasty], None));
    assert!(told.contains("NOTE    w.example: has cosigned nothing yet; run the witness once more"), "{told}");
    succeeded(&witness(&scene.service.url, &["--publish"]));
    let url = scene.service.url.clone();
    let told = succeeded(&run(&["archive-epoch", &url, "autumn", "--out", &out], None));
    assert!(!told.contains("NOTE"), "{told}");
    assert!(refused(&run(&["archive-epoch", &url, "autumn", "--out", &out], None)).contains("already exists"));

    // The service is gone.
    let archive = unpacked(&scene);
    let kept = scene.file("kept.json").to_str().unwrap().to_owned();
    let verified = |file: &str, more: &[&str]| -> Output { run(&[&["verify-archive", file], more].concat(), None) };
    let told = succeeded(&verified(&out, &["--commitment", &kept, "--witness", &key]));
    for part in ["26 of 26 grades", "2 boards", "checkpoint of", "w.example has cosigned it"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(!told.contains("BROKEN"), "{told}");
    // What the lab kept, line by line as in a journal.
    let journal = scene.file("journal.jsonl").to_str().unwrap().to_owned();
    let line = json!({ "number": 1, "drawn": { "run": 1, "response": drawn } });
    let lines = [json!({ "seed": 1 }), line.clone(), line];
    std::fs::write(&journal, lines.map(|line| format!("{line}\n")).concat()).unwrap();
    let told = succeeded(&verified(&out, &["--commitment", &kept, "--witness", &key, "--given", &journal]));
    assert!(!told.contains("none was given"), "{told}");
    a_journal_is_looked_up_in_the_log(&scene, &archive, &journal);
    if is_postgres() {
        // What follows reads files alone, whichever database the epoch was in.
        return;
    }
    only_what_was_saved_in_time_is_a_promise(&scene, &archive);
    mistakes_of_a_verifier_are_no_breaches(&scene, &archive);
    // A genuine cosignature from before the epoch says nothing of it.
    let mut older = archive.clone();
    older["witnesses"]["witnesses"][0]["note"] = json!(early_note);
    let output = verified(&pack(&scene, "older", &older), &["--commitment", &kept, "--witness", &key]);
    assert!(refused(&output).contains("has not cosigned the log with all receipts"), "{}", refused(&output));
    let changes: [Change; 9] = [
        ("the announcement is withheld", |it| {
            let announced = &mut it["log"][0]["receipts"][0];
            assert!(announced["receipt"]["epoch"].is_object(), "{announced}");
            (announced["receipt"], announced["signature"]) = (Value::Null, Value::Null);
        }),
        ("an early board", |it| {
            let board = &mut it["boards"][1];
            (board["is_final"], board["is_released"], board["rows"]) = (json!(false), json!(false), json!([]));
        }),
        ("a verdict", |it| it["reveal"]["instances"][0]["overall"] = json!(true)),
        ("an answer", |it| drop(it["answers"].as_array_mut().unwrap().pop())),
        ("a receipt", |it| drop(it["log"][0]["receipts"].as_array_mut().unwrap().remove(3))),
        ("the last receipt", |it| drop(it["log"][0]["receipts"].as_array_mut().unwrap().pop())),
        ("a board", |it| it["boards"][1]["rows"][0]["passed"] = json!(26)),
        ("the checkpoint", |it| it["checkpoint"] = json!("plumbline.log/1\n3\nAAAA\n\n— plumbline.log/1 AAAA\n")),
        ("the cosignature", |it| it["witnesses"]["witnesses"][0]["note"] = Value::Null),
    ];
    let mut changed = archive.clone();
    for (_, change) in CHANGES_OF_THE_PAGE {
        change(&mut changed);
    }
    let told = refused(&verified(&pack(&scene, "changed", &changed), &["--commitment", &kept, "--witness", &key]));
    assert_eq!(told.matches("BROKEN  epoch page").count(), CHANGES_OF_THE_PAGE.len(), "{told}");
    for (what, change) in changes.into_iter().chain(CHANGES_OF_THE_LOG) {
        let mut changed = archive.clone();
        change(&mut changed);
        let file = pack(&scene, "changed", &changed);
        let output = verified(&file, &["--commitment", &kept, "--witness", &key]);
        assert_eq!(output.status.code(), Some(1), "{what}: {}", refused(&output));
        assert!(refused(&output).contains("BROKEN"), "{what}");
    }
    // What is not there cannot be checked.
    let mut lacking = archive.clone();
    lacking["boards"].as_array_mut().unwrap().pop();
    let told = succeeded(&verified(&pack(&scene, "lacking", &lacking), &["--commitment", &kept, "--witness", &key]));
    assert!(told.contains("NOT CHECKED  the official board"), "{told}");
    what_is_no_archive_is_no_breach(&scene, &archive, &std::fs::read(&out).unwrap());
    // A browser may have unpacked it, and a shell saved it in its own way.
    std::fs::write(scene.file("unpacked"), format!("\u{feff}{archive}")).unwrap();
    succeeded(&verified(scene.file("unpacked").to_str().unwrap(), &["--commitment", &kept, "--witness", &key]));
}

/// `verify-receipt` takes a journal beside the pages of the log, and still demands all of the log.
fn a_journal_is_looked_up_in_the_log(scene: &Scene, archive: &Value, journal: &str) {
    let key = archive["log"][0]["receipts"][0]["public_key"].as_str().unwrap();
    let verified = |page: &Value| {
        let page = written(scene, "page.json", &page.to_string());
        run(&["verify-receipt", &page, journal, "--key", key], None)
    };
    let told = succeeded(&verified(&archive["log"][0]));
    assert_eq!(told.matches("is at position").count(), 2, "{told}");
    let mut cut = archive["log"][0].clone();
    drop(cut["receipts"].as_array_mut().unwrap().pop());
    assert!(refused(&verified(&cut)).contains("BROKEN  end of the log"), "{}", refused(&verified(&cut)));
    let none = written(scene, "none.json", &json!({ "seed": 1 }).to_string());
    let told = refused(&run(&["verify-receipt", &none, "--key", key], None));
    assert!(told.contains("none.json: expected a receipt, a page of the log"), "{told}");
}

/// A file that is no archive is told as such.
fn what_is_no_archive_is_no_breach(scene: &Scene, archive: &Value, whole: &[u8]) {
    std::fs::write(scene.file("cut"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(scene.file("text"), "<!doctype html>").unwrap();
    std::fs::write(scene.file("empty"), "").unwrap();
    let mut page = GzEncoder::new(Vec::new(), flate2::Compression::fast());
    page.write_all(b"<html>").unwrap();
    std::fs::write(scene.file("page.gz"), page.finish().unwrap()).unwrap();
    std::fs::write(scene.file("halved"), &archive.to_string()[..999]).unwrap();
    let mut damaged = whole.to_vec();
    let middle = damaged.len() / 2;
    damaged[middle..middle + 64].fill(0);
    std::fs::write(scene.file("damaged"), damaged).unwrap();
    pack(scene, "newer", &json!({ "plumbline_archive": 2 }));
    for (name, why) in [
        ("cut", "ends in the middle"),
        ("halved", "ends in the middle"),
        ("text", "a page of HTML"),
        ("empty", "is empty"),
        ("damaged", "compressed bytes are damaged"),
        ("page.gz", "a page of HTML"),
        ("newer", "missing field"),
        ("missing", "No such file"),
    ] {
        let output = run(&["verify-archive", scene.file(name).to_str().unwrap()], None);
        assert_eq!(output.status.code(), Some(2), "{name}");
        let told = refused(&output);
        assert!(told.contains("is no archive of an epoch") && told.contains(why), "{name}: {told}");
    }
}

/// The wrong file, or a part of the right one, is told as such: only the service can break its word.
fn mistakes_of_a_verifier_are_no_breaches(scene: &Scene, archive: &Value) {
    let write = |name: &str, text: String| written(scene, name, &text);
    let reveal = write("reveal.json", archive["reveal"].to_string());
    let board = |change: &dyn Fn(&mut Value)| {
        let mut board = archive["boards"][1].clone();
        change(&mut board);
        run(&["verify-epoch", &reveal, "--board", &write("board.json", board.to_string())], None)
    };
    assert!(succeeded(&board(&|_| {})).contains("1 board recomputed"));
    // When a board was fetched nobody can show, but what no board of any time says is a breach.
    let unreleased = |board: &mut Value| {
        (board["is_final"], board["is_released"]) = (json!(false), json!(false));
        board["rows"] = json!([]);
    };
    let told = succeeded(&board(&unreleased));
    assert!(told.contains("NOT CHECKED  board of the official tier: was fetched before its scores"), "{told}");
    let changes: [Change; 6] = [
        ("although it says that its scores are not released", |board| board["is_released"] = json!(false)),
        ("shows 77 registered entries", |board| {
            board["rows"] = json!([]);
            board["registered"] = json!(77);
        }),
        ("says that it is released and is not final", |board| board["is_released"] = json!(true)),
        ("does not say whether it is released and final", |board| {
            drop(board.as_object_mut().unwrap().remove("is_final"));
        }),
        ("is not a response of GET", |board| board["rows"][0]["passed"] = json!("all")),
        ("does not say whether", |board| board["is_final"] = Value::Null),
    ];
    for (what, change) in changes {
        let output = board(&|board| {
            (board["is_final"], board["is_released"]) = (json!(false), json!(false));
            change(board);
        });
        assert!(output.status.code() == Some(1) && refused(&output).contains(what), "{what}: {}", refused(&output));
    }
    for (wrong, why) in [
        (board(&|board| board["epoch"] = json!("other")), "is of the epoch \"other\""),
        (board(&|board| board["tier"] = json!("gold")), "is no board of an epoch"),
        (run(&["verify-epoch", &reveal, "--board", &reveal], None), "is no board of an epoch"),
        (run(&["verify-epoch", &reveal, "--receipts", &reveal], None), "is a reveal"),
        (run(&["verify-receipt", &reveal, "--key", &"0".repeat(64)], None), "is a reveal"),
    ] {
        assert_eq!(wrong.status.code(), Some(2), "{why}");
        assert!(refused(&wrong).contains(why), "{why}: {}", refused(&wrong));
    }
    // An epoch of another version of the rules breaks no promise; this program cannot recompute it.
    for (member, why) in [("checks_version", "of the checks, and this program"), ("rules/protocol", "of the protocol")]
    {
        let mut other = archive["reveal"].clone();
        *other.pointer_mut(&format!("/commitment/{member}")).unwrap() = json!(77);
        let output = run(&["verify-epoch", &write("other.json", other.to_string())], None);
        assert_eq!(output.status.code(), Some(2), "{}", refused(&output));
        let told = refused(&output);
        assert!(
            told.contains(why) && told.contains("a release that has version 77") && !told.contains("BROKEN"),
            "{told}"
        );
    }
    // Answers that lack some are a breach, unless they were cut off: one line says both.
    let answers: Vec<String> = archive["answers"].as_array().unwrap().iter().map(Value::to_string).collect();
    let cut = write("cut.ndjson", answers[..answers.len() - 5].join("\n"));
    let output = run(&["verify-epoch", &reveal, "--answers", &cut], None);
    assert_eq!(output.status.code(), Some(1));
    let told = refused(&output);
    assert_eq!(told.matches("BROKEN").count(), 1, "{told}");
    assert!(told.contains("BROKEN  answers: lack 5 logs") && told.contains("fetch them again"), "{told}");

    // A key that is not trusted is one finding, however many receipts have it.
    let page = write("page.json", archive["log"][0].to_string());
    let output = run(&["verify-receipt", &page, "--key", &"0".repeat(64)], None);
    assert_eq!(output.status.code(), Some(1));
    let told = refused(&output);
    assert!(told.contains(" receipts, from 1 to ") && told.contains("give it with --key"), "{told}");
    assert_eq!(told.matches("BROKEN").count(), 2, "the receipts, and the head: {told}");
    // A page that is missing is named.
    let key = archive["log"][0]["receipts"][0]["public_key"].as_str().unwrap();
    let mut gap = archive["log"][0].clone();
    let receipts = gap["receipts"].as_array_mut().unwrap();
    drop(receipts.drain(9..11));
    drop(receipts.drain(3..7));
    let output = run(&["verify-receipt", &write("gap.json", gap.to_string()), "--key", key], None);
    let told = refused(&output);
    assert_eq!((output.status.code(), told.matches("BROKEN").count()), (Some(1), 2), "{told}");
    assert!(told.contains("receipts 10 to 11 are missing"), "{told}");
    assert!(told.contains("receipts 4 to 7 are missing") && told.contains("after=3&limit=1000"), "{told}");

    // The announcement is the first receipt; and a page may hide a body, but not half of a receipt.
    let with_log = |change: &dyn Fn(&mut Vec<Value>)| {
        let mut page = archive["log"][0].clone();
        change(page["receipts"].as_array_mut().unwrap());
        run(&["verify-epoch", &reveal, "--receipts", &write("changed.json", page.to_string())], None)
    };
    assert!(!succeeded(&with_log(&|_| {})).contains("BROKEN"));
    for (change, why) in [
        (with_log(&|log| drop(log.remove(0))), "the log does not start at receipt 1"),
        (with_log(&|log| log[5]["receipt"] = Value::Null), "its body or its signature, but not both"),
    ] {
        assert_eq!(change.status.code(), Some(1), "{why}");
        assert!(refused(&change).contains(why), "{why}: {}", refused(&change));
    }
}

/// What says nothing about the epoch is no evidence of a breach, and no promise.
fn only_what_was_saved_in_time_is_a_promise(scene: &Scene, archive: &Value) {
    let write = |name: &str, text: String| written(scene, name, &text);
    let reveal = write("reveal.json", archive["reveal"].to_string());
    let with = |change: &dyn Fn(&mut Value)| {
        let mut epoch: Value = serde_json::from_slice(&std::fs::read(scene.file("kept.json")).unwrap()).unwrap();
        change(&mut epoch);
        run(&["verify-epoch", &reveal, "--commitment", &write("epoch.json", epoch.to_string())], None)
    };
    let promised = succeeded(&with(&|_| {}));
    assert!(!promised.contains("NOT CHECKED  commitment"), "{promised}");
    let late = succeeded(&with(&|epoch| epoch["state"] = archive["epoch"]["state"].clone()));
    assert!(
        late.contains("was saved after the epoch had closed") && late.contains("NOT CHECKED  commitment"),
        "{late}"
    );
    let other = with(&|epoch| epoch["commitment"]["epoch"] = "other".into());
    assert!(refused(&other).contains("is of the epoch \"other\", and the reveal of \"autumn\""));
    let itself = run(&["verify-epoch", &reveal, "--commitment", &reveal], None);
    assert!(refused(&itself).contains("this is the reveal"));
    let foreign = json!({ "instance": "other", "log": { "palette": [], "turns": [] } }).to_string();
    let foreign = run(&["verify-epoch", &reveal, "--answers", &write("foreign.ndjson", foreign)], None);
    assert!(refused(&foreign).contains("its answers are to no instance of the epoch \"autumn\""));
    // No answers at all are withheld ones.
    let withheld = run(&["verify-epoch", &reveal, "--answers", &write("withheld.ndjson", String::new())], None);
    assert!(withheld.status.code() == Some(1) && refused(&withheld).contains("BROKEN"));
    for wrong in [other, itself, foreign] {
        assert_eq!(wrong.status.code(), Some(2));
    }
}
