//! A data directory of the last release, killed with submissions waiting: it opens, answers as before, and finishes its
//! work.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::support::commands::{plumbline, succeeded};
use crate::support::{PROGRAM, Service, repository};

fn unpacked(folder: &Path) {
    let archive = repository("tests/fixtures/release-0.1.0.tar.gz");
    let tar = Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder).status().unwrap();
    assert!(tar.success());
}

fn json(file: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

#[tokio::test]
async fn a_data_directory_of_the_last_release_opens_as_before() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    unpacked(folder.path());
    let database = folder.path().join("plumbline.db");
    let service = Service::start_as_told(&database, &[]);
    let answers = json(&folder.path().join("answers.json"));
    for (path, before) in answers.as_object().unwrap() {
        if path == "quota" {
            let shown = succeeded(&plumbline(&["quota", "show", "--name", "south lab"], &database));
            assert!(shown.contains("50") && shown.contains("47"), "{shown}");
            continue;
        }
        // A name without a version means the newest suite, which that release did not have.
        let now = service.get(&path.replace("/mineceraft-lite", "/mineceraft-lite@2")).await;
        assert!(now.status.is_success(), "{path}: {}", now.text);
        let mut now = now.json();
        without_later_members(&mut now);
        let mut before = before.clone();
        without_later_members(&mut before);
        let before = &before;
        if path == "/v1/receipts" {
            // Grading what waited adds to the log; what it held stays.
            let both = [before, &now].map(|log| log["receipts"].as_array().unwrap());
            assert_eq!(both[0][..], both[1][..both[0].len()], "{path}");
            continue;
        }
        if path == "/v1/suites" {
            // Newer suites stand beside those of that release.
            let of_release =
                |suite: &Value| before["suites"].as_array().unwrap().iter().any(|own| own["id"] == suite["id"]);
            now["suites"].as_array_mut().unwrap().retain(of_release);
        }
        assert_eq!(*before, now, "{path}");
    }
    for id in json(&folder.path().join("queued.json")).as_array().unwrap() {
        let path = format!("/v1/submissions/{}", id.as_str().unwrap());
        service.wait_for(&path, |submission| submission["state"] == "graded").await;
    }
    assert!(service.terminate());
}

/// Removes what later versions tell of every answer and run, the profile and the track that they had without a name,
/// and what they tell beside other boards alone: results from elsewhere.
fn without_later_members(value: &mut Value) {
    match value {
        Value::Object(members) => {
            if members.get("profile").is_some_and(|profile| profile == "published") {
                members.remove("profile");
            }
            if members.get("track").is_some_and(|track| track == "specified") {
                members.remove("track");
            }
            members.remove("reported");
            members.remove("tracks");
            members.values_mut().for_each(without_later_members);
        }
        Value::Array(items) => items.iter_mut().for_each(without_later_members),
        _ => {}
    }
}

#[tokio::test]
async fn a_service_whose_program_is_replaced_still_runs_action_code() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("plumbline");
    std::fs::copy(PROGRAM, &program).unwrap();
    let service = Service::start_by(Command::new(&program), &folder.path().join("p.db"), &["--open"]);
    // As a package manager does it: another file takes the name.
    std::fs::remove_file(&program).unwrap();
    std::fs::write(&program, "another version").unwrap();
    let body = json!({ "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);", "profile": "mindcraft" });
    // More than were made ready before.
    for _ in 0..8 {
        let replayed = service.post_json("/v1/replay", &body).await;
        assert_eq!(replayed.status, 200, "{}", replayed.text);
    }
}
