//! Environment variables that nothing reads: a misspelt option would be ignored without a word.

use clap::{Command, CommandFactory as _};

use super::Cli;
use plumbline_engine::text::nearest;

/// Beginning of the names of all variables of the program.
const PREFIX: &str = "PLUMBLINE_";
/// Greatest number of slips in a misspelt name.
const SLIPS: usize = 2;

/// Returns a warning for each variable whose name is nearly that of an option.
#[must_use]
pub fn warnings() -> Vec<String> {
    let mut known = Vec::new();
    add_known(&Cli::command(), &mut known);
    let set = std::env::vars_os().filter_map(|(name, _)| name.into_string().ok());
    set.filter_map(|name| warning(&name, &known)).collect()
}

fn add_known(command: &Command, known: &mut Vec<String>) {
    known.extend(command.get_arguments().filter_map(|option| Some(option.get_env()?.to_str()?.to_owned())));
    for command in command.get_subcommands() {
        add_known(command, known);
    }
}

fn warning(name: &str, known: &[String]) -> Option<String> {
    let given = name.strip_prefix(PREFIX).filter(|_| !known.iter().any(|own| own == name))?;
    let meant = known.iter().filter_map(|own| own.strip_prefix(PREFIX));
    let meant = nearest(given, meant, |_| SLIPS)?;
    Some(format!("{name} is set in the environment, but nothing reads it; did you mean {PREFIX}{meant}?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_variables_are_told_and_others_left_alone() {
        let mut known = Vec::new();
        add_known(&Cli::command(), &mut known);
        for name in ["PLUMBLINE_DATABASE", "PLUMBLINE_KEY", "PLUMBLINE_WITNESSES"] {
            assert!(known.iter().any(|own| own == name), "{name}");
            assert_eq!(warning(name, &known), None);
        }
        for (name, meant) in [("PLUMBLINE_DATABSE", "PLUMBLINE_DATABASE?"), ("PLUMBLINE_LISTN", "PLUMBLINE_LISTEN?")] {
            assert!(warning(name, &known).is_some_and(|told| told.ends_with(meant)), "{name}");
        }
        for name in ["PLUMBLINE_PROGRAM", "PLUMBLINE_TEST_KILL", "DATABASE", "PLUMBLINE_"] {
            assert_eq!(warning(name, &known), None, "{name}");
        }
    }
}
