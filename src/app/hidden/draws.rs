//! Draws the instances of an entry's runs.

use serde::{Deserialize, Serialize};

use super::body::NewDrawBody;
use super::draw::decide_draw;
use super::entries::entrants_entry;
use super::epochs::{not_open, secret_of, stored_epoch};
use super::instances::{IssuedInstance, with_prompts};
use super::siblings::siblings;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::clock::steady::is_doubted;
use crate::clock::{now_ms, rfc3339};
use crate::store::draws::{DrawRefusal, Issued, NewDraw};
use crate::store::entries::EntryRow;
use crate::store::epochs::EpochRow;
use crate::store::keys::Scope;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::issue::Lot;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::hex;
use plumbline_engine::text::counted;

/// A drawn run.
#[derive(Debug)]
pub struct DrawnRun {
    /// Its instances, in the order of issue.
    pub instances: Vec<IssuedInstance>,
    /// Proof that they were not chosen; none in an epoch without a key of draws.
    pub proof: Option<DrawProof>,
    /// Receipt of the draw; none for a draw of an older program.
    pub receipt: Option<GivenReceipt>,
}

/// Proof of a draw, with what it is about.
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct DrawProof {
    /// Name of the epoch, whose commitment has the key of draws.
    #[schema(example = "2026-11")]
    pub epoch: String,
    /// Identifier of the entry.
    #[schema(format = Uuid)]
    pub entry: String,
    /// Number of the run within the entry, from 1.
    #[schema(minimum = 1)]
    pub run: u32,
    /// Nonce that the entrant chose.
    pub nonce: String,
    /// The proof, in hex: ECVRF-EDWARDS25519-SHA512-TAI (RFC 9381) over the lines `plumbline draw`, epoch, entry, run
    /// and nonce.
    #[schema(pattern = "^[0-9a-f]{160}$")]
    pub proof: String,
    /// The output that it proves, in hex. It decides which specifications the run draws.
    #[schema(pattern = "^[0-9a-f]{128}$")]
    pub output: String,
}

/// Draws the instances of a run, or returns the drawn ones if the nonce is the same. The draft is `None` if its body is
/// no object; `faults` holds the faults of the body so far.
///
/// # Errors
/// Returns all faults of the body, a conflict if the run cannot be drawn, and a refusal if the caller may not
/// act on the entry.
pub async fn draw_run(
    app: &App,
    caller: &Caller,
    entry_id: &str,
    draft: Option<NewDrawBody>,
    mut faults: Faults,
) -> AppResult<DrawnRun> {
    caller.require(Scope::Submit)?;
    let entry = entrants_entry(app, caller, entry_id).await?;
    let (given, nonce) = draft.map_or((None, None), |draw| (draw.run, draw.nonce));
    let run = given.and_then(|run| u32::try_from(run).ok()).filter(|run| (1..=entry.runs).contains(run));
    if given.is_some() && run.is_none() {
        faults.add_at("run", no_such_run(&entry));
    }
    let (Some(run), Some(nonce), true) = (run, nonce, faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    let epoch = stored_epoch(app, &entry.epoch_id).await?;
    // What is drawn expires by this clock, and shares that ended by it are given to others.
    if is_doubted() {
        return Err(AppError::clock_in_doubt());
    }
    let now = now_ms();
    let secret = secret_of(&app.store, &epoch).await?;
    // A proof takes a millisecond: it is computed before the transaction, in which others would wait for it.
    let lot = Lot::of(&epoch.commitment, &secret.key, entry_id, run, &nonce);
    let siblings = match epoch.commitment.siblings {
        Some(_) => Some(siblings(epoch.commitment.generator_version).await?),
        None => None,
    };
    let new = NewDraw { entry_id, run, nonce: &nonce, secret: &secret, lot: &lot, siblings };
    match app.store.issue_instances(&new, decide_draw, now).await? {
        Issued::Instances(rows, receipt) => {
            let mut instances = Vec::with_capacity(rows.len());
            for row in rows {
                instances.push(with_prompts(app, row).await?);
            }
            Ok(DrawnRun { instances, proof: proof_of(&lot, &epoch, entry_id, run, nonce.clone()), receipt })
        }
        Issued::Refused(refusal) => Err(refused(refusal, &entry, &epoch)),
    }
}

/// Returns the proof of a lot, if it has one.
fn proof_of(lot: &Lot<'_>, epoch: &EpochRow, entry: &str, run: u32, nonce: String) -> Option<DrawProof> {
    let Lot::Proven { output, proof } = lot else { return None };
    let (epoch, entry) = (epoch.id().to_owned(), entry.to_owned());
    Some(DrawProof { epoch, entry, run, nonce, proof: proof.clone(), output: hex(output) })
}

/// Creates the failure for a run that cannot be drawn.
fn refused(refusal: DrawRefusal, entry: &EntryRow, epoch: &EpochRow) -> AppError {
    match refusal {
        DrawRefusal::NoSuchRun => {
            let mut faults = Faults::new();
            faults.add_at("run", no_such_run(entry));
            AppError::faulty(faults)
        }
        DrawRefusal::OtherNonce => {
            AppError::conflict("already-drawn", "the run has already been drawn, with another nonce")
        }
        DrawRefusal::Closed if entry.finalized_at_ms.is_some() => {
            AppError::conflict("finalized", "the entry is finalized")
        }
        DrawRefusal::Closed => not_open(epoch),
        DrawRefusal::NoPool => no_pool(epoch),
        DrawRefusal::Exhausted => {
            let detail =
                "the reservation of this run has ended, and the epoch's pool has no room for it; nothing was issued";
            AppError::conflict("pool-used-up", detail)
        }
        DrawRefusal::ShareUsedUp(most) => {
            let detail = format!(
                "the reservation of this run has ended, and the owner holds the maximum of {most} runs of the pool; \
                 nothing was issued"
            );
            AppError::conflict("share-used-up", detail)
        }
    }
}

/// Creates the conflict for an epoch whose pool is not made.
fn no_pool(epoch: &EpochRow) -> AppError {
    let detail = epoch.commitment.beacon.as_ref().map_or_else(String::new, |beacon| {
        format!(
            "the pool derives from round {} of the beacon {}, emitted at {}, which this service has not got yet; anybody may \
             bring it: POST /v1/epochs/{}/beacon with \"round\" and \"signature\", from /{}/public/{} of a server of the beacon",
            beacon.round,
            beacon.chain_hash,
            rfc3339(beacon.emitted_at_ms()),
            epoch.id(),
            beacon.chain_hash,
            beacon.round
        )
    });
    AppError::conflict("no-pool", detail).retry_after(5)
}

fn no_such_run(entry: &EntryRow) -> String {
    format!("out of range: the entry has {}", counted(entry.runs, "run"))
}
