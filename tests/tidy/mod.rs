//! The order of the house: which room imports what, how long files are, what they begin with.

use std::path::{Path, PathBuf};

use crate::support::repository;

/// Greatest number of lines of a source file; 300 is the habit.
const MAX_LINES: usize = 400;
/// Names of drawers that take anything.
const DRAWERS: [&str; 6] = ["utils", "helpers", "common", "misc", "types", "manager"];
/// Rooms, and the rooms that each may import besides itself.
const ROOMS: &[(&str, &[&str])] = &[
    ("voxel", &[]),
    ("elasticity", &["voxel"]),
    ("checks", &["voxel", "elasticity"]),
    ("tasks", &["voxel", "checks"]),
    ("builders", &["voxel", "elasticity", "tasks"]),
    ("grading", &["voxel", "elasticity", "checks", "tasks"]),
    ("epochs", &["voxel", "elasticity", "checks", "tasks", "builders", "grading"]),
    ("store", &["clock", "voxel", "checks", "tasks", "grading", "epochs"]),
    ("actions", &["fair", "voxel"]),
    ("worker", &["clock", "threads", "elasticity", "tasks", "grading", "epochs", "store"]),
    (
        "http",
        &[
            "actions",
            "clock",
            "fair",
            "near",
            "threads",
            "voxel",
            "elasticity",
            "checks",
            "tasks",
            "grading",
            "builders",
            "epochs",
            "store",
        ],
    ),
];
/// Rooms that know no runtime, log, clock, thread, file or network, and the words that would show one.
const PURE: [&str; 7] = ["voxel", "elasticity", "checks", "tasks", "builders", "grading", "epochs"];
const IMPURE_WORDS: [&str; 9] =
    ["tokio::", "tracing::", "std::fs", "std::net", "std::thread", "SystemTime", "Instant", "rayon::", "std::process"];
/// Crates that only one room may name.
const CONFINED: [(&str, &[&str]); 3] =
    [("sqlx::", &["src/store/"]), ("axum::", &["src/http/"]), ("askama::", &["src/http/"])];

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// Each source file by its path in the repository, with its text.
fn read() -> Vec<(String, String)> {
    let root = repository("");
    let files = sources(&root.join("src")).into_iter().chain(sources(&root.join("tests")));
    let name = |path: &Path| path.strip_prefix(&root).unwrap().to_str().unwrap().to_owned();
    files.map(|path| (name(&path), std::fs::read_to_string(&path).unwrap())).collect()
}

/// The text without its tests: these may import what they like.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]").next().unwrap_or_default()
}

fn assert_none(faults: &[String]) {
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn rooms_import_only_what_they_may() {
    let mut faults = Vec::new();
    for (name, text) in read() {
        let Some((room, allowed)) = ROOMS.iter().find(|(room, _)| name.starts_with(&format!("src/{room}/"))) else {
            continue;
        };
        for part in without_tests(&text).split("crate::").skip(1) {
            let imported: String = part.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect();
            if imported != *room && !allowed.contains(&imported.as_str()) {
                faults.push(format!("{name} imports {imported}"));
            }
        }
    }
    assert_none(&faults);
}

#[test]
fn pure_rooms_know_no_world() {
    let mut faults = Vec::new();
    for (name, text) in read() {
        if PURE.iter().any(|room| name.starts_with(&format!("src/{room}/"))) {
            let code = without_tests(&text);
            faults.extend(IMPURE_WORDS.iter().filter(|w| code.contains(**w)).map(|w| format!("{name} names {w}")));
        }
        for (word, places) in CONFINED {
            let is_elsewhere = name.starts_with("src/") && !places.iter().any(|place| name.starts_with(place));
            if is_elsewhere && text.contains(word) {
                faults.push(format!("{name} names {word}"));
            }
        }
    }
    assert_none(&faults);
}

#[test]
fn files_say_what_they_are_for_and_stay_short() {
    let mut faults = Vec::new();
    for (name, text) in read() {
        if !text.starts_with("//! ") {
            faults.push(format!("{name} does not begin with its purpose"));
        }
        let lines = text.lines().count();
        if lines > MAX_LINES {
            faults.push(format!("{name} has {lines} lines"));
        }
        let mut parts = name.trim_end_matches(".rs").split('/');
        if parts.any(|part| DRAWERS.contains(&part)) {
            faults.push(format!("{name} is a drawer for anything"));
        }
    }
    assert_none(&faults);
}
