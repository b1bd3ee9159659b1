//! Commands of the program, run on a database, and what they say.

use std::path::Path;
use std::process::{Command, Output};

use super::PROGRAM;
use super::database::named;

pub fn plumbline(arguments: &[&str], database: &Path) -> Output {
    let mut database = named(database);
    if arguments.first() == Some(&"tasks") {
        // Tasks have no secrets.
        database.truncate(2);
    }
    Command::new(PROGRAM).args(arguments).args(database).output().unwrap()
}

pub fn told(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Asserts that a command did well, and gives what it prints.
pub fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{}", told(output));
    String::from_utf8(output.stdout.clone()).unwrap().trim().to_owned()
}

/// Asserts that a command refuses, and gives what it says.
pub fn refused(output: &Output) -> String {
    assert!(!output.status.success(), "{}", told(output));
    told(output)
}

/// A new key of an owner, with the default scopes.
pub fn key(database: &Path, owner: &str) -> String {
    succeeded(&plumbline(&["keys", "create", "--name", owner], database))
}
