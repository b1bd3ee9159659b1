//! The crates that the program is built from are those that docs/supply-chain.md lists and that were read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use crate::support::repository;
use serde_json::Value;

/// What cargo knows of the crates of the program on Linux, with the allocator for production.
fn metadata() -> Value {
    let mut command = Command::new(env!("CARGO"));
    command.args(["metadata", "--locked", "--format-version", "1", "--filter-platform", "x86_64-unknown-linux-gnu"]);
    command.args(["--features", "jemalloc"]);
    let output = command.current_dir(repository("")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The crates that are part of the program, without those that only come in for these kinds of use.
fn of_program<'a>(metadata: &'a Value, without: &[&str]) -> Vec<&'a Value> {
    let packages: BTreeMap<&str, &Value> =
        metadata["packages"].as_array().unwrap().iter().map(|own| (own["id"].as_str().unwrap(), own)).collect();
    let nodes: BTreeMap<&str, &Value> =
        metadata["resolve"]["nodes"].as_array().unwrap().iter().map(|own| (own["id"].as_str().unwrap(), own)).collect();
    let root = metadata["resolve"]["root"].as_str().unwrap();
    let (mut seen, mut next) = (BTreeSet::new(), vec![root]);
    while let Some(id) = next.pop() {
        if !seen.insert(id) {
            continue;
        }
        for dependency in nodes[id]["deps"].as_array().unwrap() {
            let kinds = dependency["dep_kinds"].as_array().unwrap();
            if kinds.iter().any(|kind| !without.iter().any(|other| kind["kind"] == *other)) {
                next.push(dependency["pkg"].as_str().unwrap());
            }
        }
    }
    seen.into_iter().map(|id| packages[id]).collect()
}

#[test]
fn crates_come_from_one_registry_and_their_build_scripts_were_read() {
    let metadata = metadata();
    let program = of_program(&metadata, &["dev"]);
    assert!(program.len() > 300, "{}", program.len());
    let foreign: Vec<&Value> = program
        .iter()
        .map(|own| &own["source"])
        .filter(|source| !source.is_null() && *source != "registry+https://github.com/rust-lang/crates.io-index")
        .collect();
    assert_eq!(foreign, Vec::<&Value>::new());

    let has_script = |own: &&&Value| {
        let mut targets = own["targets"].as_array().unwrap().iter();
        !own["source"].is_null() && targets.any(|target| target["kind"][0] == "custom-build")
    };
    let with_script: BTreeSet<&str> =
        program.iter().filter(has_script).map(|own| own["name"].as_str().unwrap()).collect();
    let text = std::fs::read_to_string(repository("docs/supply-chain.md")).unwrap();
    let table = text.split_once("## Build scripts").unwrap().1.split_once("## Unsafe code").unwrap().0;
    assert_eq!(with_script, listed(table), "read the build scripts, and correct docs/supply-chain.md");
}

/// Returns whether a crate's own source has `unsafe` code; what only its comments say does not count.
fn has_unsafe_code(own: &Value) -> bool {
    let manifest = Path::new(own["manifest_path"].as_str().unwrap());
    let mut folders = vec![manifest.parent().unwrap().join("src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().map(Result::unwrap) {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
                let code = text.lines().filter_map(|line| line.split("//").next());
                if code.flat_map(|line| line.split("unsafe").skip(1)).any(begins_unsafe) {
                    return true;
                }
            }
        }
    }
    false
}

/// Returns whether what follows the word `unsafe` makes it code.
fn begins_unsafe(rest: &str) -> bool {
    ["{", "fn", "impl", "trait", "extern"].iter().any(|word| rest.trim_start().starts_with(word))
}

#[test]
fn crates_with_unsafe_code_are_listed() {
    let metadata = metadata();
    let mut program = of_program(&metadata, &["dev", "build"]);
    program.retain(|own| !own["source"].is_null());
    assert!(program.len() > 300, "{}", program.len());
    let with_unsafe: BTreeSet<&str> =
        program.into_iter().filter(|own| has_unsafe_code(own)).map(|own| own["name"].as_str().unwrap()).collect();
    let text = std::fs::read_to_string(repository("docs/supply-chain.md")).unwrap();
    let part = text.split_once("All crates that have any").unwrap().1.split_once("## Reproducible").unwrap().0;
    assert_eq!(with_unsafe, listed(part), "review what is new, and correct docs/supply-chain.md");
    let before = text.split_once("## Unsafe code").unwrap().1.split_once("All crates that have any").unwrap().0;
    for row in before.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| input")) {
        for name in row.split('|').nth(2).unwrap().split(',').map(str::trim) {
            assert!(with_unsafe.contains(name), "{name} has no unsafe code, so it is not to be told of");
        }
    }
}

/// Returns the crates in the last column of a table.
fn listed(table: &str) -> BTreeSet<&str> {
    let rows = table.lines().filter(|line| line.starts_with("| ")).skip(1);
    rows.flat_map(|row| row.trim_end_matches(" |").rsplit('|').next().unwrap().split(',').map(str::trim)).collect()
}

#[test]
fn the_documented_versions_of_native_code_are_those_that_are_built() {
    let metadata = metadata();
    let text = std::fs::read_to_string(repository("docs/supply-chain.md")).unwrap();
    for (name, file, begins) in [
        ("libsqlite3-sys", "sqlite3/sqlite3.h", &["#define SQLITE_VERSION "][..]),
        (
            "rquickjs-sys",
            "quickjs/quickjs.h",
            &["#define QJS_VERSION_MAJOR", "#define QJS_VERSION_MINOR", "#define QJS_VERSION_PATCH"],
        ),
        (
            "zstd-sys",
            "zstd/lib/zstd.h",
            &["#define ZSTD_VERSION_MAJOR", "#define ZSTD_VERSION_MINOR", "#define ZSTD_VERSION_RELEASE"],
        ),
    ] {
        let program = of_program(&metadata, &["dev"]);
        let package = program.into_iter().find(|own| own["name"] == name).unwrap();
        let folder = Path::new(package["manifest_path"].as_str().unwrap()).parent().unwrap().to_owned();
        let header = std::fs::read_to_string(folder.join(file)).unwrap();
        let of_line = |begin: &&str| {
            let line = header.lines().find(|line| line.starts_with(begin)).unwrap_or_else(|| panic!("{name}: {begin}"));
            line.split_whitespace().nth(2).unwrap().trim_matches('"').to_owned()
        };
        let version = begins.iter().map(of_line).collect::<Vec<_>>().join(".");
        must_be_listed(&text, name, &version);
    }
    // The allocator's version is a part of that of its crate: 0.7.1+5.3.1-0-g81034ce1.
    let allocator = of_program(&metadata, &["dev"]).into_iter().find(|own| own["name"] == "tikv-jemalloc-sys").unwrap();
    let carried = allocator["version"].as_str().unwrap().split(['+', '-']).nth(1).unwrap();
    must_be_listed(&text, "tikv-jemalloc-sys", carried);
}

fn must_be_listed(text: &str, name: &str, version: &str) {
    let row = text.lines().find(|line| line.contains(&format!("| {name} |"))).unwrap();
    assert!(row.contains(&format!("| {version} |")), "{name} carries {version}: {row}");
}

/// What `cargo deny check licenses` checks too, where that is installed: each crate may be used under a licence that
/// deny.toml allows.
#[test]
fn licences_are_those_that_deny_toml_allows() {
    let deny: toml::Table = std::fs::read_to_string(repository("deny.toml")).unwrap().parse().unwrap();
    let allowed: BTreeSet<&str> =
        deny["licenses"]["allow"].as_array().unwrap().iter().map(|licence| licence.as_str().unwrap()).collect();
    let metadata = metadata();
    for own in of_program(&metadata, &["dev"]) {
        let (name, licence) = (&own["name"], own["license"].as_str().unwrap_or_default());
        // Expressions here are choices of combinations without parentheses around choices.
        let plain = licence.replace('/', " OR ").replace(['(', ')'], "");
        let may_be_used = if licence.contains(") AND") || licence.contains("AND (") {
            plain.split([' ']).filter(|word| !["OR", "AND", ""].contains(word)).any(|word| allowed.contains(word))
                && plain.split(" AND ").all(|part| part.split(" OR ").any(|one| allowed.contains(one.trim())))
        } else {
            plain.split(" OR ").any(|choice| choice.split(" AND ").all(|one| allowed.contains(one.trim())))
        };
        assert!(may_be_used, "{name}: {licence}");
    }
}
