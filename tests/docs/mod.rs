//! The documents: links resolve, cited sections exist, examples run, and commands are ones that the program has.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use plumbline::app::error::Kind;
use plumbline::http::problem::status_of;
use serde_json::Value;

use crate::support::{PROGRAM, Service, repository};

/// Documents that people read, by their paths in the repository.
fn documents() -> Vec<PathBuf> {
    fn add(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() && !name.starts_with('.') && name != "target" {
                add(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    add(&repository(""), &mut found);
    found.sort();
    assert!(found.len() > 15, "{found:?}");
    found
}

/// The text outside code blocks.
fn prose(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// Anchors of a document's headings, as forges make them.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text);
    let headings = headings.lines().filter(|line| line.starts_with('#'));
    let anchor = |heading: &str| -> String {
        let words = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = words.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

fn assert_none(faults: &[String]) {
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn links_resolve() {
    let mut faults = Vec::new();
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        for link in
            prose(&text).split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link.to_owned())
        {
            if link.contains("://") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target = if file.is_empty() { document.clone() } else { document.parent().unwrap().join(file) };
            let has_anchor = || anchors(&std::fs::read_to_string(&target).unwrap()).contains(anchor);
            if !target.exists() || (!anchor.is_empty() && !has_anchor()) {
                faults.push(format!("{}: {link}", document.display()));
            }
        }
    }
    assert_none(&faults);
}

#[test]
fn sections_that_code_cites_exist() {
    fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                sources(&path, found);
            } else {
                found.push(path);
            }
        }
    }
    let rules = anchors(&std::fs::read_to_string(repository("docs/rules.md")).unwrap());
    let (mut files, mut faults, mut cited) = (Vec::new(), Vec::new(), 0);
    for folder in ["src", "engine/src", "engine/tests"] {
        sources(&repository(folder), &mut files);
    }
    for file in files {
        let Ok(text) = std::fs::read_to_string(&file) else { continue };
        for rest in text.split("docs/rules.md#").skip(1) {
            let anchor: String = rest.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
            cited += 1;
            if !rules.contains(&anchor) {
                faults.push(format!("{}: {anchor}", file.display()));
            }
        }
    }
    assert_none(&faults);
    assert!(cited > 40, "only {cited} citations were found");
}

/// Rows of the tables of a document: the name in code marks, and the second cell.
fn rows(text: &str) -> BTreeMap<String, String> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| `")?.split(" | ");
        Some((cells.next()?.strip_suffix('`')?.to_owned(), cells.next()?.to_owned()))
    };
    text.lines().filter_map(row).collect()
}

#[test]
fn every_type_of_problem_is_described() {
    fn add_conflicts(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                add_conflicts(&path, found);
                continue;
            }
            let Ok(text) = std::fs::read_to_string(&path) else { continue };
            let names = text.split("::conflict(").skip(1).map(|rest| {
                let literal = rest.trim_start().strip_prefix('"').and_then(|rest| rest.split('"').next());
                literal.unwrap_or_else(|| panic!("{}: a conflict without its name", path.display())).to_owned()
            });
            found.extend(names);
        }
    }
    let text = std::fs::read_to_string(repository("docs/errors.md")).unwrap();
    let (kinds, conflicts) = text.split_once("## Conflicts").unwrap();
    let stated = Kind::ALL.iter().map(|kind| (kind.name().to_owned(), status_of(*kind).as_u16().to_string()));
    assert_eq!(rows(kinds), stated.collect());
    let mut named = BTreeSet::new();
    add_conflicts(&repository("src"), &mut named);
    assert_eq!(rows(conflicts).into_keys().collect::<BTreeSet<_>>(), named);
}

/// Commands in blocks of shell, a line each; continued lines are joined.
fn commands(text: &str) -> Vec<String> {
    let blocks = text.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
    let lines = blocks.map(|block| block.replace("\\\n", " ")).collect::<String>();
    lines.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).map(str::to_owned).collect()
}

#[test]
fn commands_in_documents_are_ones_that_there_are() {
    let mut faults = Vec::new();
    for document in documents() {
        for command in commands(&std::fs::read_to_string(&document).unwrap()) {
            let mut words = command.split_whitespace();
            let is_known = match words.next().unwrap() {
                // The tests of the Python package compare its commands with its help.
                "pip" | "export" | "plumbline-client" | "inspect" | "lm_eval" | "--tasks"
                    if document.ends_with("clients/python/README.md") =>
                {
                    true
                }
                // Cargo, and what examples and tests/run do, is tested by running it.
                "cargo" | "curl" => true,
                "bash" => repository(words.next().unwrap()).exists(),
                "plumbline" => {
                    let given: Vec<&str> = words.take_while(|word| !word.starts_with('#')).collect();
                    let subcommands = given.iter().take_while(|word| {
                        word.chars().all(|c| c.is_ascii_lowercase() || c == '-') && !word.starts_with('-')
                    });
                    let names: Vec<&&str> = subcommands.take(2).collect();
                    let help = |count: usize| {
                        Command::new(PROGRAM).args(names.iter().take(count)).arg("--help").output().unwrap()
                    };
                    let help = [2, 1].map(help).into_iter().find(|output| output.status.success());
                    let text = help.map(|output| String::from_utf8(output.stdout).unwrap()).unwrap_or_default();
                    given.iter().filter(|word| word.starts_with("--")).all(|option| text.contains(option))
                        && !text.is_empty()
                }
                _ => false,
            };
            if !is_known {
                faults.push(format!("{}: {command}", document.display()));
            }
        }
    }
    assert_none(&faults);
}

fn example(script: &str) -> Command {
    let mut command = Command::new("bash");
    command.arg(repository("examples").join(script));
    command
}

fn succeeded(mut command: Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[tokio::test]
async fn examples_run_as_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &["--board-coverage", "0"]);
    let against = |script: &str| {
        let mut command = example(script);
        command.env("PLUMBLINE_SERVER", &service.url);
        command
    };
    let board = succeeded(against("run.sh"));
    assert!(board.contains("\"overall\":true") && board.contains("my-agent 1"), "{board}");
    let rewards = succeeded(against("rewards.sh"));
    assert_eq!(rewards.matches("\"overall\":true").count(), 3, "{rewards}");
    let picture = folder.path().join("picture.png");
    let mut stepwise = against("episode.sh");
    stepwise.env("PICTURE", &picture);
    let episode = succeeded(stepwise);
    assert!(episode.contains("\"blocks\":5") && episode.contains("\"submission\":"), "{episode}");
    assert!(std::fs::read(picture).unwrap().starts_with(b"\x89PNG"));
    let mut operate = example("operate.sh");
    operate.current_dir(folder.path()).env("PLUMBLINE_PROGRAM", PROGRAM);
    let said = succeeded(operate);
    assert!(said.contains("autumn"), "{said}");
    let mut replay = Command::new(PROGRAM);
    replay.arg("replay").arg(repository("examples/action-code.js"));
    assert_eq!(succeeded(replay).lines().count(), 25);
}

#[tokio::test]
async fn the_readme_shows_what_the_service_answers() {
    let readme = std::fs::read_to_string(repository("README.md")).unwrap();
    let shown = readme.split("```json\n").nth(1).unwrap().split("```").next().unwrap();
    let mut shown: Value = serde_json::from_str(shown).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let service = Service::start(&folder.path().join("p.db"), &[]);
    let wall = std::fs::read(repository("examples/wall.json")).unwrap();
    let graded = service.post("/v1/grade", "application/json", wall.clone()).await;
    let mut graded = graded.json();
    for answer in [&mut shown, &mut graded] {
        answer["timings"].take();
    }
    assert_eq!(shown, graded);
    assert_eq!(service.post("/v1/submissions", "application/json", wall).await.status, 202);
}
