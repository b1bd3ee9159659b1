//! The order of the house: imports run downwards, no files form a ring, files are short and say what they are for.

mod deploy;
mod imports;
mod supply;

use std::path::{Path, PathBuf};

use crate::support::repository;
use imports::{rings, without_tests};

/// Greatest number of lines of a source file; 300 is the habit.
const MAX_LINES: usize = 400;
/// Names of folders and files that take anything.
const DRAWERS: [&str; 6] = ["utils", "helpers", "common", "misc", "types", "manager"];
/// Rooms of the engine, from the ground up: each may import those before it.
const ENGINE: [&str; 10] =
    ["text", "voxel", "game", "intake", "elasticity", "checks", "tasks", "builders", "grading", "hidden"];
/// Rooms of the service, and the rooms that each may import besides itself and the engine.
const SERVICE: &[(&str, &[&str])] = &[
    ("actions", &["fair"]),
    ("formats", &[]),
    ("pictures", &[]),
    ("store", &["clock", "tls"]),
    ("app", &["actions", "clock", "fair", "formats", "pictures", "store", "threads", "tls"]),
    ("worker", &["app", "clock", "store", "threads"]),
    ("http", &["actions", "app", "clock", "fair", "formats", "pictures", "store"]),
];
/// Words that would show that the engine knows the world.
const IMPURE: [&str; 9] =
    ["tokio::", "tracing::", "std::fs", "std::net", "std::thread", "SystemTime", "Instant", "rayon::", "std::process"];
/// Crates that only one room may name.
const CONFINED: [(&str, &[&str]); 4] = [
    ("object_store::", &["src/store/blobs/"]),
    ("sqlx::", &["src/store/"]),
    ("axum::", &["src/http/"]),
    ("askama::", &["src/http/"]),
];

/// A source file by its path in the repository.
struct Source {
    name: String,
    text: String,
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_in(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

fn read(folder: &str) -> Vec<Source> {
    let root = repository("");
    let name = |path: &Path| path.strip_prefix(&root).unwrap().to_str().unwrap().to_owned();
    let source = |path: PathBuf| Source { name: name(&path), text: std::fs::read_to_string(&path).unwrap() };
    files_in(&root.join(folder)).into_iter().map(source).collect()
}

fn assert_none(faults: &[String]) {
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Names after `crate::` in the code of a file.
fn imported(text: &str) -> impl Iterator<Item = String> {
    without_tests(text)
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| line.split("crate::").skip(1))
        .map(|part| part.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect())
}

#[test]
fn rooms_of_the_service_import_only_what_they_may() {
    let mut faults = Vec::new();
    for Source { name, text } in read("src") {
        let Some((room, allowed)) = SERVICE.iter().find(|(room, _)| name.starts_with(&format!("src/{room}/"))) else {
            continue;
        };
        let is_wrong = |import: &String| import != room && !allowed.contains(&import.as_str());
        faults.extend(imported(&text).filter(is_wrong).map(|import| format!("{name} imports {import}")));
    }
    assert_none(&faults);
}

#[test]
fn rooms_of_the_engine_import_downwards_and_know_no_world() {
    let mut faults = Vec::new();
    for Source { name, text } in read("engine/src") {
        let Some(floor) = ENGINE.iter().position(|room| name.starts_with(&format!("engine/src/{room}/"))) else {
            continue;
        };
        let is_wrong = |import: &String| !ENGINE[..=floor].contains(&import.as_str());
        faults.extend(imported(&text).filter(is_wrong).map(|import| format!("{name} imports {import}")));
        let code = without_tests(&text);
        faults.extend(IMPURE.iter().filter(|word| code.contains(**word)).map(|word| format!("{name} names {word}")));
    }
    assert_none(&faults);
}

#[test]
fn crates_of_one_room_stay_there() {
    let mut faults = Vec::new();
    for Source { name, text } in read("src") {
        for (word, rooms) in CONFINED {
            if !rooms.iter().any(|room| name.starts_with(room)) && text.contains(word) {
                faults.push(format!("{name} names {word}"));
            }
        }
    }
    assert_none(&faults);
}

#[test]
fn files_form_no_ring() {
    let mut faults = Vec::new();
    for folder in ["src", "engine/src"] {
        let sources: Vec<(String, String)> =
            read(folder).into_iter().map(|source| (source.name, source.text)).collect();
        faults.extend(rings(folder, &sources).into_iter().map(|ring| ring.join(" -> ")));
    }
    assert_none(&faults);
}

#[test]
fn files_say_what_they_are_for_and_stay_short() {
    let mut faults = Vec::new();
    for Source { name, text } in ["src", "tests", "engine"].into_iter().flat_map(read) {
        if !text.starts_with("//! ") {
            faults.push(format!("{name} does not begin with its purpose"));
        }
        if name != "tests/tidy/mod.rs" && text.contains("super::super::") {
            faults.push(format!("{name} climbs two floors with super::super::"));
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
