//! Cosignatures that witnesses send, and the checkpoint that they have cosigned.

use super::log::root_at;
use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::now_ms;
use crate::store::cosignatures::CosignatureRow;
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::hidden::tlog::note::Checkpoint;

/// Seconds that the clock of a witness may be ahead of ours.
const AHEAD_S: i64 = 300;

/// A witness with its latest cosignature.
#[derive(Debug)]
pub struct Witnessed {
    /// The witness.
    pub witness: Witness,
    /// Its latest cosignature; none if it has sent none.
    pub latest: Option<CosignatureRow>,
}

/// Takes a checkpoint with cosignatures of witnesses that the operator knows.
///
/// # Errors
/// Returns a fault if the note is no checkpoint of this log, or has no cosignature of a known witness, and an error if
/// the database fails.
pub async fn take(app: &App, note: &str) -> AppResult<()> {
    // What costs nothing comes first: anybody may send notes.
    let lines = Checkpoint::parts(note).map(|(_, lines)| lines).unwrap_or_default();
    let names: Vec<String> = app.witnesses.iter().map(|witness| format!("— {} ", witness.name)).collect();
    if !lines.is_empty() && !lines.iter().any(|line| names.iter().any(|name| line.starts_with(name))) {
        return Err(unknown());
    }
    let keys = app.store.receipt_keys().await?;
    let trusted: Vec<&str> = keys.iter().map(String::as_str).chain([app.receipt_key.as_str()]).collect();
    let fault = |detail: &str| AppError::new(Kind::BadRequest, detail);
    let checkpoint = Checkpoint::verified(note, &trusted).ok_or_else(|| {
        fault("the note is not a checkpoint signed by this log; start from what /log/checkpoint returns")
    })?;
    // Our own signature says that it was ours, but not that it still is: a database may have been put back.
    if root_at(app, &checkpoint.origin, checkpoint.size).await? != Some(checkpoint.root) {
        return Err(AppError::conflict(
            "other-history",
            "this log does not have the checkpoint, though it is signed with its key",
        ));
    }
    let (text, lines) = Checkpoint::parts(note).expect("a verified note has its parts");
    // Other lines may have the name of the log.
    let mut notes = lines.iter().map(|line| format!("{text}\n{line}\n"));
    let signed = notes.find(|note| Checkpoint::verified(note, &trusted).is_some());
    let signed = signed.expect("a verified note has the signature of the log");
    let now_s = now_ms() / 1_000;
    let stored = app.store.cosignatures().await?;
    let mut is_known = false;
    for witness in &app.witnesses {
        let Some((line, at_s)) = lines.iter().find_map(|line| Some((*line, witness.cosigned(line, &checkpoint)?)))
        else {
            continue;
        };
        let at_s = i64::try_from(at_s).ok().filter(|at_s| *at_s <= now_s + AHEAD_S);
        let at_s = at_s.ok_or_else(|| fault("the cosignature is from the future: set the clock of the witness"))?;
        let (size, checkpoint) = (checkpoint.size.cast_signed(), signed.clone());
        let row = CosignatureRow { witness: witness.key.clone(), size, checkpoint, line: line.to_owned(), at_s };
        // What is sent again need not wait for the writer.
        let is_later = |known: &CosignatureRow| (row.size, row.at_s) > (known.size, known.at_s);
        if stored.iter().find(|known| known.witness == row.witness).is_none_or(is_later) {
            app.store.put_cosignature(&row).await?;
        }
        is_known = true;
    }
    if is_known {
        return Ok(());
    }
    Err(unknown())
}

fn unknown() -> AppError {
    AppError::new(
        Kind::BadRequest,
        "the note has no cosignature of a witness that the operator knows; `plumbline witness --name` prints the key, and the operator \
         starts the service with `--witness KEY`",
    )
}

/// Returns the witnesses that the operator knows, with what each cosigned last.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn witnesses(app: &App) -> AppResult<Vec<Witnessed>> {
    let rows = app.store.cosignatures().await?;
    let latest = |witness: &Witness| rows.iter().find(|row| row.witness == witness.key).cloned();
    Ok(app.witnesses.iter().map(|witness| Witnessed { latest: latest(witness), witness: witness.clone() }).collect())
}

/// Returns the last checkpoint that a known witness has cosigned, as a note with the cosignatures of all that did.
///
/// # Errors
/// Returns an error (404) if there is none, or an error if the database fails.
pub async fn cosigned(app: &App) -> AppResult<String> {
    let all = witnesses(app).await?;
    let rows: Vec<&CosignatureRow> = all.iter().filter_map(|witnessed| witnessed.latest.as_ref()).collect();
    let missing = || AppError::not_found("no witness that the operator knows has cosigned the log yet");
    let last = rows.iter().max_by_key(|row| row.size).ok_or_else(missing)?;
    let same = rows.iter().filter(|row| row.size == last.size);
    Ok(same.fold(last.checkpoint.clone(), |note, row| note + &row.line + "\n"))
}
