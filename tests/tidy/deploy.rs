//! The files of deploy/ name options, variables, profiles and features that exist.

use std::collections::BTreeSet;
use std::process::Command;

use crate::support::{PROGRAM, repository};

/// Returns the text of a file in deploy/.
fn text_of(path: &str) -> String {
    std::fs::read_to_string(repository("deploy").join(path)).unwrap()
}

fn help(command: &str) -> String {
    let output = Command::new(PROGRAM).args([command, "--help"]).output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

/// Returns the words of a text that begin with some characters and go on with letters, digits, `_` and `-`.
fn words<'a>(text: &'a str, beginning: &str) -> BTreeSet<&'a str> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    text.match_indices(beginning)
        .map(|(at, _)| {
            let rest = &text[at..];
            &rest[..rest.find(|c| !is_part(c)).unwrap_or(rest.len())]
        })
        .collect()
}

#[test]
fn options_and_variables_of_examples_exist() {
    let known = help("serve") + &help("work");
    // Commands that run the program: lines of units, of the container file and of the example.
    let mut commands = BTreeSet::new();
    for path in ["systemd/plumbline.service", "systemd/plumbline-web.service", "systemd/plumbline-work.service"] {
        let unit = text_of(path);
        let line = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/usr/local/bin/plumbline ")).unwrap();
        commands.insert(line.to_owned());
        assert!(
            unit.contains("NoNewPrivileges=yes") && unit.contains("ProtectSystem=strict"),
            "{path} is not confined"
        );
        for name in words(&unit, "PLUMBLINE_") {
            assert!(known.contains(&format!("[env: {name}")), "{path} sets {name}, which nothing reads");
        }
    }
    for path in ["Containerfile", "compose/compose.yaml"] {
        let text = text_of(path);
        for name in words(&text, "PLUMBLINE_") {
            assert!(known.contains(&format!("[env: {name}")), "{path} sets {name}, which nothing reads");
        }
        let lists =
            text.lines().filter_map(|line| line.trim().strip_prefix("command: [").or(line.strip_prefix("CMD [")));
        let own = lists
            .map(|list| list.trim_end_matches(']').replace(['"', ','], ""))
            .filter(|line| !line.starts_with("caddy"));
        commands.extend(own);
    }
    assert_eq!(commands.len(), 5, "{commands:?}");
    for command in commands {
        let mut parts = command.split(' ');
        let options = help(parts.next().unwrap());
        for option in parts.filter(|part| part.starts_with("--")) {
            assert!(options.contains(&format!("{option} ")), "{command}: there is no {option}");
        }
    }
    // The image and a release are built with a profile and a feature of the manifest.
    let manifest = std::fs::read_to_string(repository("Cargo.toml")).unwrap();
    let built = [text_of("Containerfile"), text_of("release")];
    for (text, (option, section)) in built
        .iter()
        .flat_map(|text| [("--profile", "profile"), ("--features", "features")].map(|option| (text, option)))
    {
        let name = text.split_once(&format!("{option} ")).unwrap().1.split_whitespace().next().unwrap();
        let wanted = if section == "profile" { format!("[profile.{name}]") } else { format!("\n{name} = [") };
        assert!(manifest.contains(&wanted), "{wanted}");
        assert!(text.contains(&format!("/{name}/plumbline")) || section == "features");
    }
}
