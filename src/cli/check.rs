//! `plumbline check`: reads everything in a database and says what is damaged.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::checksums;
use super::database::DatabaseArgs;
use super::process::block_on;
use crate::store::LOST;
use crate::store::blobs::place_of;
use crate::store::checking::{Found, FoundKind, check};
use plumbline_engine::text::counted;

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    database: DatabaseArgs,
}

/// Runs the command, with exit code 1 if anything is damaged, and 2 if something could not be checked.
///
/// # Errors
/// Returns an error if the database cannot be opened.
pub fn run(args: &CheckArgs) -> anyhow::Result<ExitCode> {
    args.database.name();
    let (mut damaged, mut unreached, mut missing) = (0_u64, 0_u64, 0_u64);
    // A backup has its checksum beside it.
    if let Some(file) = args.database.database.file() {
        let noted = PathBuf::from(format!("{}.sha256", file.display()));
        if noted.exists()
            && let Err(error) = checksums::verify(&noted, &[file])
        {
            damaged += 1;
            println!("DAMAGED  {error:#}");
        }
    }
    let (mut last_reason, mut has_lost_objects) = (String::new(), false);
    let mut tell = |Found { kind, place, detail }: Found| match kind {
        FoundKind::Damaged => {
            damaged += 1;
            has_lost_objects |= detail.contains(LOST);
            println!("DAMAGED  {place}: {detail}");
        }
        FoundKind::Unreached => {
            unreached += 1;
            // One place is unreachable for all that is in it.
            if last_reason != detail {
                println!("NOT CHECKED  {place}: {detail}");
                last_reason = detail;
            }
        }
        FoundKind::Noted => println!("NOTE     {place}: {detail}"),
        FoundKind::Missing => {
            missing += 1;
            println!("NOTE     {place}: {detail}");
        }
    };
    let counts =
        block_on(async { Ok(check(&args.database.database, &args.database.kept_secrets(), &mut tell).await?) })?;
    let unreached_place = match block_on(async { Ok(place_of(&args.database.database).await?) }) {
        Ok(None | Some((_, None))) => None,
        Ok(Some((place, Some(error)))) => Some((place.to_string(), error.to_string())),
        Err(error) => Some(("place of large logs".to_owned(), format!("{error:#}"))),
    };
    if let Some((place, detail)) = unreached_place {
        tell(Found { kind: FoundKind::Unreached, place, detail });
    }
    for (name, rows) in counts {
        println!("{name}: {}", counted(rows, "row"));
    }
    if missing > 0 {
        println!(
            "name the folder that holds the keys with --secrets; a backup has them only if it was made --with-secrets"
        );
    }
    if unreached > 0 {
        println!("{} could not be checked: make it reachable, and check again", counted(unreached, "item"));
    }
    if damaged > 0 {
        println!("{}: restore the last backup that passes this check", counted(damaged, "fault"));
        if has_lost_objects {
            println!("an object that is lost needs no restore of the database: copy it from the backup of its place");
        }
        return Ok(ExitCode::FAILURE);
    }
    if unreached > 0 {
        return Ok(ExitCode::from(2));
    }
    println!("nothing is damaged");
    Ok(ExitCode::SUCCESS)
}
