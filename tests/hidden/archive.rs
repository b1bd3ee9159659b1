//! The archive of an epoch: one file that is verified without the service.

use std::io::{Read as _, Write as _};
use std::process::Output;

use crate::support::commands::{refused, succeeded};
use crate::support::epoch::{Scene, run};
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
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
    scene.answer(&lab, &instances, 2).await;
    scene.made(&lab, &format!("/v1/entries/{entry}/finalize"), &json!({})).await;
    scene.end_epoch().await;
    let hasty = scene.file("hasty.archive").to_str().unwrap().to_owned();
    let told = succeeded(&run(&["archive-epoch", &scene.service.url, "autumn", "--out", &hasty], None));
    assert!(told.contains("NOTE    w.example: has cosigned 0 entries of the log, and the epoch needs"), "{told}");
    succeeded(&witness(&scene.service.url, &["--publish"]));
    let url = scene.service.url.clone();
    let told = succeeded(&run(&["archive-epoch", &url, "autumn", "--out", &out], None));
    assert!(!told.contains("NOTE"), "{told}");
    assert!(refused(&run(&["archive-epoch", &url, "autumn", "--out", &out], None)).contains("already exists"));

    // The service is gone.
    let archive = unpacked(&scene);
    only_what_was_saved_in_time_is_a_promise(&scene, &archive);
    let kept = scene.file("kept.json").to_str().unwrap().to_owned();
    let verified = |file: &str, more: &[&str]| -> Output { run(&[&["verify-archive", file], more].concat(), None) };
    let told = succeeded(&verified(&out, &["--commitment", &kept, "--witness", &key]));
    // A genuine cosignature from before the epoch says nothing of it.
    let mut older = archive.clone();
    older["witnesses"]["witnesses"][0]["note"] = json!(early_note);
    let output = verified(&pack(&scene, "older", &older), &["--commitment", &kept, "--witness", &key]);
    assert!(refused(&output).contains("has not cosigned the log with all receipts"), "{}", refused(&output));
    for part in ["26 of 26 grades", "2 boards", "checkpoint of", "w.example has cosigned it"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(!told.contains("BROKEN"), "{told}");
    let changes: [Change; 7] = [
        ("a verdict", |it| it["reveal"]["instances"][0]["overall"] = json!(true)),
        ("an answer", |it| drop(it["answers"].as_array_mut().unwrap().pop())),
        ("a receipt", |it| drop(it["log"][0]["receipts"].as_array_mut().unwrap().remove(3))),
        ("the last receipt", |it| drop(it["log"][0]["receipts"].as_array_mut().unwrap().pop())),
        ("a board", |it| it["boards"][1]["rows"][0]["passed"] = json!(26)),
        ("the checkpoint", |it| it["checkpoint"] = json!("plumbline.log/1\n3\nAAAA\n\n— plumbline.log/1 AAAA\n")),
        ("the cosignature", |it| it["witnesses"]["witnesses"][0]["note"] = Value::Null),
    ];
    for (what, change) in changes {
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
    // What is no archive is no breach.
    let whole = std::fs::read(&out).unwrap();
    std::fs::write(scene.file("cut"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(scene.file("text"), "<!doctype html>").unwrap();
    let newer = pack(&scene, "newer", &json!({ "plumbline_archive": 2 }));
    for file in [scene.file("cut").to_str().unwrap(), scene.file("text").to_str().unwrap(), "missing", &newer] {
        let output = verified(file, &[]);
        assert_eq!(output.status.code(), Some(2), "{file}");
        assert!(refused(&output).contains("is no archive of an epoch"), "{file}: {}", refused(&output));
    }
}

/// What says nothing about the epoch is no evidence of a breach, and no promise.
fn only_what_was_saved_in_time_is_a_promise(scene: &Scene, archive: &Value) {
    let write = |name: &str, text: String| {
        std::fs::write(scene.file(name), text).unwrap();
        scene.file(name).to_str().unwrap().to_owned()
    };
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
