//! The suite in the binary: against the published task files, its schema and table against the code, and its faults.

use std::path::Path;

use crate::repository;
use plumbline_engine::grading::saboteur_table;
use plumbline_engine::tasks::family::{SuiteSource, entailment_table, json_schema};
use plumbline_engine::tasks::published::{TaskFile, read_task_files};
use plumbline_engine::tasks::{embedded, hidden};
use serde_json::Value;

fn texts(folder: &Path) -> Vec<(String, String)> {
    let entries = std::fs::read_dir(folder).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file());
    let read = |entry: std::fs::DirEntry| {
        (entry.file_name().into_string().unwrap(), std::fs::read_to_string(entry.path()).unwrap())
    };
    entries.map(read).collect()
}

fn files(texts: &[(String, String)]) -> Vec<TaskFile<'_>> {
    texts.iter().map(|(name, text)| TaskFile { name, text }).collect()
}

/// Number by number and turn by turn, the checks of version 1 are those of the published files.
#[test]
fn the_first_version_has_the_published_checks() {
    let texts = texts(&repository("tests/conformance/tasks"));
    let published = read_task_files(&files(&texts)).unwrap();
    let ours = embedded::suite(1).unwrap();
    assert_eq!(published.len(), ours.tasks.len());
    for (published, ours) in published.iter().zip(&ours.tasks) {
        assert_eq!((published.number, published.turns.len()), (ours.number, ours.turns.len()), "{}", ours.id);
        for (published, turn) in published.turns.iter().zip(&ours.turns) {
            assert_eq!(published.checks, turn.checks, "{}", ours.id);
            assert!(turn.informational.is_empty(), "{}", ours.id);
        }
    }
}

/// The arches of version 2 show the two published surface checks and count our own instead.
#[test]
fn the_second_version_shows_the_published_rules_for_arches() {
    for task in embedded::suite(2).unwrap().tasks {
        let is_arch = task.kind.as_deref() == Some("arch-bridges");
        let names = |checks: &[plumbline_engine::checks::Check]| {
            checks.iter().map(plumbline_engine::checks::Check::name).collect::<Vec<_>>()
        };
        for turn in &task.turns {
            let shown: &[&str] =
                if is_arch { &["shape.is_top_surface_concave", "shape.is_bottom_surface_concave"] } else { &[] };
            assert_eq!(names(&turn.informational), shown, "{}", task.id);
            assert_eq!(names(&turn.checks).contains(&"shape.is_true_arch"), is_arch, "{}", task.id);
        }
    }
}

#[test]
fn the_schema_in_the_repository_is_the_one_that_the_code_makes() {
    let kept: Value =
        serde_json::from_str(&std::fs::read_to_string(repository("tasks/family.schema.json")).unwrap()).unwrap();
    assert!(kept == json_schema(), "write it again: cargo run -- tasks schema > tasks/family.schema.json");
}

#[test]
fn the_tables_of_what_asks_for_checks_are_those_that_the_code_makes() {
    let kept = std::fs::read_to_string(repository("tasks/entailment.md")).unwrap();
    let [.., public] = embedded::sources().unwrap();
    for source in [public, hidden::source(hidden::LATEST).unwrap()] {
        let made = entailment_table(&source);
        assert!(kept.contains(&made), "write it again: cargo run -- tasks entailment > tasks/entailment.md");
        assert!(made.lines().count() > 100, "{made}");
    }
}

/// Faults of a suite of walls whose checks must be asked for, with one passage of its file replaced.
fn faults_of_asking(passage: &str, instead: &str) -> Vec<String> {
    let suite = "name = 'x'\nfamilies = ['walls']\nversions = [{ number = 3, description = '' }]\n\
                 every_check_is_asked_for = true\npreamble = '{{ site }} {{ joined }} {{ path_rule }}'\n\
                 words = { site = 'Here.', joined = 'All hangs together.', path_rule = 'Work steadily.' }\n\
                 lite = { seed = 1, tasks = [] }";
    faults_with("tasks/mineceraft-3/walls.toml", suite, 3, passage, instead)
}

#[test]
fn a_check_that_nothing_asks_for_is_a_fault() {
    assert!(faults_of_asking("family", "family").is_empty());
    for (passage, instead, expected) in [
        ("asked_by = [\"site\"]\n", "", "checks.0.fn: asked_by: missing"),
        ("asked_by = [\"site\"]", "asked_by = [\"sight\"]", "checks.0.fn: asked_by: there is no phrase \"sight\""),
        ("{{ joined }}", "", "checks.1.fn: asked_by: no prompt of the track specified has the phrase joined"),
        ("brief = [", "unmeasured = ['the weather']\nbrief = [", "unmeasured: no prompt contains {{ unmeasured }}"),
        ("brief = [", "brief = ['', ", "the wording \"raise\" has 2 brief prompts, and needs 1 brief prompt"),
    ] {
        let found = faults_of_asking(passage, instead);
        assert!(found.iter().any(|fault| fault.contains(expected)), "{instead}: {found:#?}");
    }
}

#[test]
fn the_table_of_saboteurs_in_the_readme_is_the_one_that_the_code_makes() {
    let readme = std::fs::read_to_string(repository("tasks/README.md")).unwrap();
    let made = saboteur_table::markdown(&embedded::latest().unwrap());
    assert!(readme.contains(&made), "put the output of `cargo run -- tasks saboteurs` into tasks/README.md:\n{made}");
}

/// Faults of a suite of one family, whose file is `walls.toml` with one passage replaced.
fn faults_of(passage: &str, instead: &str) -> Vec<String> {
    let suite = "name = 'x'\nfamilies = ['walls']\nversions = [{ number = 2, description = '' }]\n\
                 words = { site = 'a', joined = 'b', path_rule = 'c' }\nlite = { seed = 1, tasks = [] }";
    faults_with("tasks/mineceraft/walls.toml", suite, 2, passage, instead)
}

/// Faults of a version of a suite of walls, with one passage of the family's file replaced.
fn faults_with(file: &str, suite: &str, version: u32, passage: &str, instead: &str) -> Vec<String> {
    let walls = std::fs::read_to_string(repository(file)).unwrap();
    assert!(walls.contains(passage), "{passage}");
    let walls = walls.replacen(passage, instead, 1);
    let files = [TaskFile { name: "walls.toml", text: &walls }, TaskFile { name: "suite.toml", text: suite }];
    let found = SuiteSource::read(&files).and_then(|source| source.suite(version));
    found.err().unwrap_or_default().iter().map(ToString::to_string).collect()
}

#[test]
fn faults_name_file_line_and_field() {
    assert!(faults_of("family", "family").is_empty());
    for (passage, instead, expected) in [
        ("w = [5, 7, 10]", "w = [5, 7, 10", "walls.toml: line 11: "),
        ("title =", "titel =", "walls.toml: line 3: unknown field `titel`"),
        ("category = \"structural-elements\"", "category = \"steel\"", "walls.toml: line 4: unknown variant `steel`"),
        ("args.y = \"{{ h }}\"", "args.y = \"{{ hight }}\"", "checks.2.args.y: undefined value"),
        ("args.y = \"{{ h }}\"", "args.y = \"{{ h + }}\"", "checks.2.args.y: syntax error"),
        (
            "args.y = \"{{ h }}\"",
            "args.hight = 3",
            "checks.2.args.hight: size.is_equal has no such argument; it takes xz, y",
        ),
        ("fn = \"size.is_equal\"", "fn = \"size.is_equel\"", "checks.2.fn: no check is called \"size.is_equel\""),
        ("t = [1, 2]", "t = [1, 2]\nu = [1]", "grid.u: 1 value, but others have 2"),
        ("{{ w }} blocks wide", "{{ wide }} blocks wide", "wordings.prompts: undefined value"),
        ("name = \"raise\"", "name = \"Raise it\"", "wordings.name: \"Raise it\" is not a name of lower-case letters"),
        ("name = \"raise\"", "name = \"courses\"", "walls.toml: instance: \"walls/10x1x5-courses\" occurs twice"),
        ("family = \"walls\"", "family = \"wall\"", "walls.toml: family: expected \"walls\""),
    ] {
        let found = faults_of(passage, instead);
        assert!(found.iter().any(|fault| fault.contains(expected)), "{instead}: {found:#?}");
        assert!(found.iter().all(|fault| fault.starts_with("walls.toml: ")), "{found:#?}");
    }
    let found = faults_of("args.y = \"{{ h }}\"", "args.y = \"{{ hight }}\"");
    assert_eq!(found.len(), 1, "once, though twelve items have it: {found:#?}");
    assert!(found[0].starts_with("walls.toml: line "), "{found:#?}");
}

#[test]
fn files_and_the_list_of_families_must_agree() {
    let suite = "name = 'x'\nfamilies = ['walls']\nversions = []\nlite = { seed = 1, tasks = [] }";
    let other = TaskFile { name: "other.toml", text: "" };
    let found = SuiteSource::read(&[other, TaskFile { name: "suite.toml", text: suite }]).unwrap_err();
    let told: Vec<String> = found.iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "suite.toml: families: there is no file walls.toml",
            "other.toml: suite.toml does not list this family",
            "suite.toml: versions: the list is empty",
        ]
    );
    assert!(SuiteSource::read(&[other]).unwrap_err()[0].to_string().contains("there is no such file"));
}
