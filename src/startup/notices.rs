//! What the operator must know before the service starts: who else serves the database, what is wrong with its secrets.

use std::path::Path;

use crate::clock::now_ms;
use crate::store::Store;
use crate::store::epochs::EpochRow;
use crate::store::location::Location;
use crate::store::serving::Serving;

/// Returns what the operator must know of the secrets: who else may read them, and which epochs cannot be revealed.
pub(super) async fn notices_of_secrets(store: &Store) -> anyhow::Result<Vec<String>> {
    let secrets = store.secrets();
    let exposed = secrets.exposed().map(|(path, mode)| {
        let (path, folder) = (path.display(), secrets.folder().display());
        format!(
            "others may read or change the secrets: {path} has mode {mode:04o}. Close the folder: chmod -R go= {folder}"
        )
    });
    // Another node of a server may have the keys that this one lacks.
    if matches!(store.location(), Location::Server(_)) {
        return Ok(exposed.into_iter().collect());
    }
    let now = now_ms();
    let epochs = store.epochs().await?;
    let lost = epochs.iter().filter(|epoch| !secrets.has_epoch(epoch.id()));
    let (lost, open): (Vec<&EpochRow>, Vec<&EpochRow>) = lost.partition(|epoch| epoch.is_over(now));
    let names = |epochs: &[&EpochRow]| epochs.iter().map(|epoch| epoch.id()).collect::<Vec<_>>().join(", ");
    let undrawn = (!open.is_empty()).then(|| {
        format!(
            "the keys of these epochs, which are not over, are not in {}, or cannot be read there: {}. Put them back: until \
             then nobody draws. If a key is lost, close its epoch (plumbline epochs close)",
            secrets.folder().display(),
            names(&open)
        )
    });
    let unrevealed = (!lost.is_empty()).then(|| {
        format!(
            "the keys of these epochs, which are over, are not in {}, or cannot be read there, so nobody can get their reveal and verify them: {}. Put \
             them back from a backup made with --with-secrets",
            secrets.folder().display(),
            names(&lost)
        )
    });
    Ok(exposed.into_iter().chain(undrawn).chain(unrevealed).collect())
}

/// Notes that this process serves a database file, if it is one; returns a notice for the operator if another process does so too.
///
/// # Errors
/// Returns an error if another user made the lock file, so that this process could not tell others that it serves.
pub(super) fn serving_notice(database: Option<&Path>) -> anyhow::Result<(Option<Serving>, Option<String>)> {
    let Some(database) = database else { return Ok((None, None)) };
    Ok(match Serving::of(database) {
        Ok(serving) => {
            let notice = serving.is_shared.then(|| {
                format!(
                    "another process serves {} too; both grade its queue. If that is a mistake, stop one of them",
                    database.display()
                )
            });
            (Some(serving), notice)
        }
        Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => anyhow::bail!(
            "cannot open {}.lock, which tells others that this process serves the database: {error}. Another user made it; \
             give it to the user of the service (chown)",
            database.display()
        ),
        Err(error) => {
            tracing::warn!(%error, "could not find out whether another process serves the database");
            (None, None)
        }
    })
}
