//! Families of one's own: files, no builder, no compiler.

use std::process::Command;

use crate::support::commands::{plumbline, refused, succeeded, told};
use crate::support::{PROGRAM, Service, repository};
use serde_json::json;

const MANIFEST: &str =
    "name = \"our-own\"\nfamilies = [\"posts\"]\n[[versions]]\nnumber = 1\ndescription = \"the first\"\n";
const FAMILY: &str = r#"family = "posts"
title = "Posts"
category = "structural-elements"
type = "posts"
description = "A post of stone."
instance = "{{ h }}"

[[grid]]
h = [3, 4]

[[wordings]]
name = "raise"
prompts = ["You stand at (0, 0, 0). Raise a post of stone, one block wide and {{ h }} blocks high, on the ground."]

[[checks]]
fn = "material.is_block_cnt_equal_to"
args.expected_count = "{{ h }}"

[[checks]]
fn = "physical_plausibility.is_ground_connected"
"#;

#[tokio::test]
async fn a_suite_is_imported_served_and_replaced_by_a_new_version() {
    let folder = tempfile::tempdir().unwrap();
    let (files, database) = (folder.path().join("suite"), folder.path().join("p.db"));
    std::fs::create_dir(&files).unwrap();
    std::fs::write(files.join("suite.toml"), MANIFEST).unwrap();
    std::fs::write(files.join("posts.toml"), FAMILY).unwrap();
    let import = || plumbline(&["tasks", "import", files.to_str().unwrap()], &database);
    let validated = Command::new(PROGRAM).args(["tasks", "validate"]).arg(&files).output().unwrap();
    assert!(succeeded(&validated).contains("posts: not certified, no builder"), "{}", told(&validated));
    let service = Service::start(&database, &[]);
    let said = succeeded(&import());
    assert!(said.contains("our-own@1, 2 problems") && said.contains("stored as our-own@1"), "{said}");
    let post = json!({ "task": 1, "suite": "our-own", "reward": "shaped",
                       "turns": [{ "palette": ["stone"], "rows": [[0, 0, 0, 0], [0, 1, 0, 0], [0, 2, 0, 0]] }] });
    // At once, although another process stored it.
    assert_eq!(service.post_json("/v1/grade", &post).await.json()["reward"], json!(1.0));
    service.wait_for("/v1/tasks?suite=our-own", |page| page["total"] == 2).await;
    let run = service.begin_run("own", "our-own").await;
    assert_eq!(service.get(&format!("/v1/runs/{run}")).await.json()["suite"], "our-own@1");
    // What was stored stays; a change is a new version.
    std::fs::write(files.join("posts.toml"), FAMILY.replace("one block wide", "a block wide")).unwrap();
    assert!(refused(&import()).contains("a change is a new version"));
    std::fs::write(files.join("suite.toml"), MANIFEST.replace("number = 1", "number = 2")).unwrap();
    succeeded(&import());
    let answer = json!({ "turns": post["turns"] }).to_string();
    let verify = json!({ "task": 1, "suite": "our-own@2", "response": { "output_text": answer } });
    assert_eq!(service.post_json("/verify", &verify).await.json()["reward"], json!(1.0));
    for _ in 0..1_000 {
        if service.get("/v1/tasks?suite=our-own").await.json()["suite"] == "our-own@2" {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    assert_eq!(service.get("/v1/tasks?suite=our-own").await.json()["suite"], "our-own@2");
    assert_eq!(service.get("/v1/tasks?suite=our-own@1").await.json()["total"], 2);
    std::fs::write(files.join("suite.toml"), MANIFEST.replace("our-own", "mineceraft")).unwrap();
    assert!(refused(&import()).contains("a suite of this program"));
}

#[test]
fn the_environment_never_makes_a_check_store_something() {
    if crate::support::database::is_postgres() {
        // Only a file is copied, locked, filled or taken over from an old release.
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    succeeded(&plumbline(&["migrate", "--create"], &database));
    let before = std::fs::read(&database).unwrap();
    let file = repository("tests/conformance/tasks/1-se-2-walls.json");
    let import =
        Command::new(PROGRAM).args(["tasks", "import"]).arg(file).env("PLUMBLINE_DATABASE", &database).output();
    assert!(succeeded(&import.unwrap()).contains("checked, not stored"));
    assert_eq!(std::fs::read(&database).unwrap(), before);
}
