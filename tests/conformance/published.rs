//! The published evaluator's numbers, through the commands that users have.

use std::process::{Command, Output};

use crate::support::{PROGRAM, repository};
use serde_json::Value;

fn run(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).current_dir(repository("tests/conformance")).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn no_vector_mismatches() {
    let output = run(&["conformance", "."]);
    let told = text(&output.stdout);
    assert!(output.status.success(), "{told}");
    for row in ["| checks | 1400  | 0 ", "| merge  | 60    | 0 ", "| run    | 4     | 0 ", "| stress | 39    | 0 "] {
        assert!(told.contains(row), "{row} is not in\n{told}");
    }
}

#[test]
fn a_wrong_vector_is_a_mismatch() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wrong.jsonl");
    let vectors = std::fs::read_to_string(repository("tests/conformance/checks.jsonl")).unwrap();
    let first = vectors.lines().next().unwrap();
    assert!(first.contains("\"expected\":1"), "{first}");
    let wrong = first.replace("\"expected\":1", "\"expected\":0");
    let unread = first.replace("\"args\":{", "\"args\":{\"cnt_\":1,");
    std::fs::write(&file, format!("{wrong}\n{unread}\n{first}\n")).unwrap();
    let output = run(&["conformance", file.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let told = text(&output.stdout);
    assert!(told.contains("MISMATCH s-material.is_block_cnt_equal_to-001"), "{told}");
    assert!(told.contains("wrong.jsonl, line 2: ") && told.contains("3 cases, 2 mismatches"), "{told}");
}

/// Compares numbers of a part of a summary: counts exactly, means within a tolerance.
fn assert_same(path: &str, found: &Value, expected: &Value) {
    match expected {
        Value::Object(members) => {
            members.iter().for_each(|(key, value)| assert_same(&format!("{path}/{key}"), &found[key], value));
        }
        Value::Number(number) if number.is_f64() => {
            let has_stress = ["stress", "structural_stability", "safety"].iter().any(|word| path.contains(word));
            let tolerance = if has_stress { 1e-6 } else { 1e-9 };
            let (a, b) = (found.as_f64().unwrap(), expected.as_f64().unwrap());
            assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{path}: {a}, expected {b}");
        }
        Value::Number(_) => assert_eq!(found.as_f64(), expected.as_f64(), "{path}"),
        other => assert_eq!(found, other, "{path}"),
    }
}

fn expected() -> Value {
    serde_json::from_slice(&std::fs::read(repository("tests/conformance/run_expected.json")).unwrap()).unwrap()
}

#[test]
fn grade_gives_the_published_summary_and_its_lite_draws() {
    let expected = expected();
    let parts = ["check_level", "problem_level", "graded", "passed_runs"];
    let output = run(&["grade", "--json", "run.jsonl"]);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    for part in parts {
        assert_same(part, &found[part], &expected[part]);
    }
    for seed in ["42", "0", "7"] {
        let output = run(&["grade", "--json", "--lite", seed, "run.jsonl"]);
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let expected = &expected["lite"][seed];
        assert_eq!(found["run_idx"], expected["run_idx"]);
        for part in parts {
            assert_same(part, &found[part], &expected[part]);
        }
    }
}

#[test]
fn grade_prints_a_table_and_names_what_is_wrong() {
    let output = run(&["grade", "run.jsonl"]);
    assert!(text(&output.stdout).contains("| overall               | 398             | 723 | 55.0 %"));
    let output = run(&["grade", "checks.jsonl"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("line 1: missing field `run_idx`"), "{}", text(&output.stderr));
}

#[test]
fn grade_warns_of_problems_without_checks() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bare.jsonl");
    let bare =
        |number: u32| format!("{{\"run_idx\":{number},\"turn_idx\":1,\"n_turns\":1,\"checks\":[],\"coords\":[]}}\n");
    std::fs::write(&file, (1..=12).map(bare).collect::<String>()).unwrap();
    let output = run(&["grade", file.to_str().unwrap()]);
    assert!(output.status.success());
    assert_eq!(
        text(&output.stderr),
        "warning: 12 problems have no checks and count as passed: run_idx 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, …\n"
    );
    let output = run(&["grade", "run.jsonl"]);
    assert_eq!(text(&output.stderr), "");
}

#[test]
fn task_files_are_counted_and_stored_once() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("p.db");
    let files: Vec<String> = std::fs::read_dir(repository("tests/conformance/tasks"))
        .unwrap()
        .map(|entry| entry.unwrap().path().to_str().unwrap().to_owned())
        .collect();
    run(&["migrate", "--create", "--database", database.to_str().unwrap()]);
    let import = |suite: &str, files: &[String]| {
        let mut arguments = vec!["tasks", "import", "--suite", suite, "--database", database.to_str().unwrap()];
        arguments.extend(files.iter().map(String::as_str));
        run(&arguments)
    };
    let first = text(&import("theirs@3", &files).stdout);
    assert!(first.contains("25 files, 723 problems, 3530 check rows over 747 entries"), "{first}");
    assert!(first.contains("stored as theirs@3"), "{first}");
    assert!(text(&import("theirs@3", &files).stdout).contains("is already stored with the same content"));
    let other = import("theirs@3", &files[..1]);
    assert_eq!(other.status.code(), Some(1));
    assert!(text(&other.stderr).contains("exists with different content"));
}
