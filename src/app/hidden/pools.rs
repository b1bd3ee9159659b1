//! The pool of an epoch that is bound to a beacon: made as soon as anybody brings the round.

use tokio::sync::Mutex;

use super::body::NewRoundBody;
use super::epochs::{EpochStatus, epoch, not_open, secret_of, stored_epoch};
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use crate::store::epochs::EpochRow;
use plumbline_engine::hidden::beacon::{Beacon, BeaconFault, BoundPool, Round};
use plumbline_engine::hidden::commitment::root_of;
use plumbline_engine::intake::Faults;

/// Held while a round is verified and a pool is made: whoever else brings the round waits, and gets the same pool.
static MAKING: Mutex<()> = Mutex::const_new(());

/// Takes the round that an epoch is bound to, and publishes its pool. The draft is `None` if its body is no object;
/// `faults` holds the faults of the body so far.
///
/// # Errors
/// Returns all faults of the body, a fault if the chain has not signed the round, and a conflict if the epoch is bound
/// to no beacon, is over, or the round is not due yet.
pub async fn take_round(
    app: &App,
    name: &str,
    draft: Option<NewRoundBody>,
    faults: Faults,
    now_ms: i64,
) -> AppResult<EpochStatus> {
    let row = stored_epoch(app, name).await?;
    let (Some(NewRoundBody { round: Some(round), signature: Some(signature), .. }), true) = (draft, faults.is_empty())
    else {
        return Err(AppError::faulty(faults));
    };
    let round = Round { round: round.cast_unsigned(), signature };
    publish_pool(&app.store, &row, &round, now_ms).await?;
    epoch(app, name).await
}

/// Verifies the round that an epoch is bound to, draws its pool, and publishes it. Returns the published pool, which
/// stays as it is.
///
/// # Errors
/// Returns a fault if the chain has not signed the round, and a conflict if the epoch is bound to no beacon, is over,
/// its key is not there, or the round is not due yet.
pub async fn publish_pool(store: &Store, epoch: &EpochRow, round: &Round, now_ms: i64) -> AppResult<BoundPool> {
    let Some(beacon) = epoch.commitment.beacon.clone() else {
        let detail = "the epoch is bound to no beacon: its pool was made before it was announced";
        return Err(AppError::conflict("no-beacon", detail));
    };
    if let Some(published) = epoch.pool.as_ref().filter(|published| published.is_from(round)) {
        return Ok(published.clone());
    }
    if epoch.pool.is_none() && epoch.is_over(now_ms) {
        return Err(not_open(epoch));
    }
    if now_ms < beacon.emitted_at_ms() {
        let detail = format!("the round is due at {}, which is not yet", rfc3339(beacon.emitted_at_ms()));
        return Err(AppError::conflict("round-not-due", detail));
    }
    let (store, epoch, round) = (store.clone(), epoch.clone(), round.clone());
    // Whoever brings a round may hang up; what was begun goes on, and is not begun again beside it.
    let made = tokio::spawn(async move { make(&store, &epoch, beacon, &round).await });
    made.await.map_err(|error| AppError::internal(&error))?
}

async fn make(store: &Store, epoch: &EpochRow, beacon: Beacon, round: &Round) -> AppResult<BoundPool> {
    let _alone = MAKING.lock().await;
    let (bound, given) = (beacon.clone(), round.clone());
    let verified = tokio::task::spawn_blocking(move || bound.randomness(&given));
    let randomness = verified.await.map_err(|error| AppError::internal(&error))?.map_err(|fault| {
        let place = match fault {
            BeaconFault::OtherRound { .. } => "round",
            BeaconFault::OtherChain(_) | BeaconFault::BadSignature { .. } => "signature",
        };
        let mut faults = Faults::new();
        faults.add_at(place, fault.to_string());
        AppError::faulty(faults)
    })?;
    if let Some(published) = store.epoch(epoch.id()).await?.and_then(|epoch| epoch.pool) {
        return Ok(published);
    }
    let secret = secret_of(store, epoch).await?;
    let (secrets, commitment) = (store.secrets().clone(), epoch.commitment.clone());
    let drawn = tokio::task::spawn_blocking(move || {
        let key = beacon.pool_key(&secret.key, &randomness);
        let pool = secrets.put_pool(&commitment, &key)?;
        Ok::<_, AppError>(root_of(&key, &pool.specifications))
    });
    let root = drawn.await.map_err(|error| AppError::internal(&error))??;
    let signature = round.signature.to_ascii_lowercase();
    let (epoch_id, round) = (epoch.id().to_owned(), round.round);
    // Drawing takes time, and the epoch may be over by now.
    let pool = BoundPool { epoch: epoch_id, round, signature, root, made_at_ms: now_ms() };
    store.publish_pool(&pool).await?.ok_or_else(|| not_open(epoch))
}
