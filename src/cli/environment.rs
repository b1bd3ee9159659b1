//! Environment variables. Empty ones count as unset. Misspelt ones are refused, because a service whose database is named
//! by a misspelt variable would begin another.

use std::ffi::OsStr;

use clap::builder::Resettable;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, CommandFactory as _, FromArgMatches as _};

use super::Cli;
use plumbline_engine::text::nearest;

/// Beginning of the names of all variables of the program.
const PREFIX: &str = "PLUMBLINE_";
/// Greatest number of slips in a misspelt name.
const SLIPS: usize = 2;
/// Number of characters of a name for each slip: of a short name, two slips make another.
const CHARACTERS_PER_SLIP: usize = 4;

/// Exit code for arguments and variables that are wrong.
pub const USAGE: u8 = 2;

/// Reads the arguments of the program. An empty variable counts as one that is not set, which is what Compose makes of a
/// variable without a value. Ends the program if an argument is wrong, and says so if it comes from the environment.
#[must_use]
pub fn parse() -> Cli {
    let value = |name: &OsStr| std::env::var_os(name);
    let command = without_empty(Cli::command(), &|name| value(name).is_some_and(|value| value.is_empty()));
    let mut known = command.clone();
    known.build();
    let parsed = command.try_get_matches().and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.unwrap_or_else(|error| {
        if error.kind() == ErrorKind::DisplayHelp {
            // With the names of the variables that are empty.
            let _ = Cli::command().get_matches();
        }
        let from = match (error.get(ContextKind::InvalidArg), error.get(ContextKind::InvalidValue)) {
            (Some(ContextValue::String(argument)), Some(ContextValue::String(wrong))) => {
                variable_of(&known, argument, &|name| value(name).is_some_and(|value| value == **wrong))
            }
            _ => None,
        };
        if let Some(name) = from {
            let _ = error.print();
            eprintln!("{name} is set in the environment");
            std::process::exit(error.exit_code());
        }
        error.exit()
    })
}

/// Returns the command without the variables that are empty.
fn without_empty(command: Command, is_empty: &impl Fn(&OsStr) -> bool) -> Command {
    let of_argument = |argument: Arg| {
        if argument.get_env().is_some_and(is_empty) { argument.env(Resettable::Reset) } else { argument }
    };
    command.mut_args(of_argument).mut_subcommands(|command| without_empty(command, is_empty))
}

/// Returns the variable that sets an argument, as the command shows it, if it is set.
fn variable_of(command: &Command, shown: &str, is_set: &impl Fn(&OsStr) -> bool) -> Option<String> {
    let own = command.get_arguments().filter(|argument| argument.to_string() == shown);
    let name = own.filter_map(Arg::get_env).find(|name| is_set(name)).map(|name| name.to_string_lossy().into_owned());
    name.or_else(|| command.get_subcommands().find_map(|command| variable_of(command, shown, is_set)))
}

/// Returns an error for each variable whose name is nearly that of an option.
#[must_use]
pub fn misspelt() -> Vec<String> {
    let mut known = Vec::new();
    add_known(&Cli::command(), &mut known);
    let set = std::env::vars_os().filter_map(|(name, _)| name.into_string().ok());
    set.filter_map(|name| misspelling(&name, &known)).collect()
}

fn add_known(command: &Command, known: &mut Vec<String>) {
    known.extend(command.get_arguments().filter_map(|option| Some(option.get_env()?.to_str()?.to_owned())));
    for command in command.get_subcommands() {
        add_known(command, known);
    }
}

fn misspelling(name: &str, known: &[String]) -> Option<String> {
    let given = name.strip_prefix(PREFIX).filter(|_| !known.iter().any(|own| own == name))?;
    let meant = known.iter().filter_map(|own| own.strip_prefix(PREFIX));
    let meant = nearest(given, meant, |meant| SLIPS.min(meant.len() / CHARACTERS_PER_SLIP))?;
    Some(format!(
        "{name} is set in the environment, but nothing reads it. If {PREFIX}{meant} is meant, correct the name; if not, unset it"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_variables_count_as_not_set_and_wrong_ones_are_named() {
        let command = without_empty(Cli::command(), &|name| name == "PLUMBLINE_WORKERS");
        let of = |command: &Command, name: &str| {
            let serve = command.find_subcommand("serve").unwrap();
            serve.get_arguments().any(|argument| argument.get_env().is_some_and(|own| own == name))
        };
        assert!(of(&Cli::command(), "PLUMBLINE_WORKERS") && !of(&command, "PLUMBLINE_WORKERS"));
        assert!(of(&command, "PLUMBLINE_LISTEN"));
        let mut known = Cli::command();
        known.build();
        let named = |is_set| variable_of(&known, "--workers <WORKERS>", &|_| is_set);
        assert_eq!((named(true).as_deref(), named(false)), (Some("PLUMBLINE_WORKERS"), None));
    }

    #[test]
    fn misspelt_variables_are_refused_and_others_left_alone() {
        let mut known = Vec::new();
        add_known(&Cli::command(), &mut known);
        for name in ["PLUMBLINE_DATABASE", "PLUMBLINE_KEY", "PLUMBLINE_WITNESSES"] {
            assert!(known.iter().any(|own| own == name), "{name}");
            assert_eq!(misspelling(name, &known), None);
        }
        for (name, meant) in
            [("PLUMBLINE_DATABSE", "If PLUMBLINE_DATABASE is"), ("PLUMBLINE_LISTN", "If PLUMBLINE_LISTEN is")]
        {
            assert!(misspelling(name, &known).is_some_and(|told| told.contains(meant)), "{name}");
        }
        let of_kubernetes = ["SERVICE_HOST", "SERVICE_PORT", "PORT", "PORT_80_TCP", "WORK_PORT", "WORK_SERVICE_HOST"];
        let of_ours = ["PROGRAM", "TEST_KILL", "DEADLINE_S", "FAULTS", ""];
        for name in of_kubernetes.iter().chain(&of_ours) {
            assert_eq!(misspelling(&format!("{PREFIX}{name}"), &known), None, "{name}");
        }
        assert_eq!(misspelling("DATABASE", &known), None);
    }
}
