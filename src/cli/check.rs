//! `plumbline check`: reads everything in a database and says what is damaged.

use std::process::ExitCode;

use clap::Args;

use super::database::DatabaseArgs;
use super::process::block_on;
use crate::store::checking::{Damage, check};
use plumbline_engine::text::counted;

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    database: DatabaseArgs,
}

/// Runs the command, with exit code 1 if anything is damaged.
///
/// # Errors
/// Returns an error if the database cannot be opened.
pub fn run(args: &CheckArgs) -> anyhow::Result<ExitCode> {
    args.database.name();
    let mut damaged = 0_u64;
    let mut tell = |Damage { place, detail }: Damage| {
        damaged += 1;
        println!("DAMAGED  {place}: {detail}");
    };
    let counts =
        block_on(async { Ok(check(&args.database.database, &args.database.kept_secrets(), &mut tell).await?) })?;
    for (name, rows) in counts {
        println!("{name}: {}", counted(rows, "row"));
    }
    if damaged == 0 {
        println!("nothing is damaged");
        return Ok(ExitCode::SUCCESS);
    }
    println!("{}: restore a backup, or keep this database and write to us", counted(damaged, "fault"));
    Ok(ExitCode::FAILURE)
}
