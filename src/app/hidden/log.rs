//! The transparency log: the tree over all receipts, which grows with the log, and checkpoints of it.

use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::Mutex;

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::store::StoreError;
use plumbline_engine::hidden::canonical::Hash;
use plumbline_engine::hidden::receipts::{InclusionProof, Signer};
use plumbline_engine::hidden::tlog::frontier::Frontier;
use plumbline_engine::hidden::tlog::note::{Checkpoint, origin, verifier_key};
use plumbline_engine::hidden::tlog::tiles::TileName;
use plumbline_engine::hidden::tlog::tree::{Tree, leaf};
use plumbline_engine::tasks::hex;

/// Number of receipts that are read at once.
const AT_ONCE: i64 = 10_000;

/// The tree in memory, about 100 bytes a receipt. It is made when it is first asked for.
#[derive(Debug, Default)]
pub struct TransparencyLog {
    grown: Mutex<Grown>,
    is_damaged: AtomicBool,
}

impl TransparencyLog {
    /// Returns whether damage to the stored log was found since the start.
    pub(in crate::app) fn is_damaged(&self) -> bool {
        self.is_damaged.load(Ordering::Relaxed)
    }
}

#[derive(Debug, Default)]
struct Grown {
    tree: Tree,
    entries: Vec<Hash>,
    /// Name of the log, once it has an entry.
    name: Option<String>,
}

impl Grown {
    /// Takes in the receipts that were added since.
    async fn grow(&mut self, app: &App) -> AppResult<()> {
        loop {
            let read = hashes(app, self.entries.len() as i64, AT_ONCE).await?;
            let is_last = (read.len() as i64) < AT_ONCE;
            for hash in read {
                self.tree.push(leaf(&hash));
                self.entries.push(hash);
            }
            if is_last {
                return Ok(());
            }
        }
    }

    /// Returns the name of the log: that of its first key, or of the key in use while it is empty.
    async fn name(&mut self, app: &App) -> AppResult<String> {
        if self.name.is_none() {
            self.name = app.store.first_receipt_key().await?.as_deref().map(origin);
        }
        Ok(self.name.clone().unwrap_or_else(|| origin(&app.receipt_key)))
    }

    /// Returns a checkpoint of the log.
    async fn checkpoint(&mut self, app: &App) -> AppResult<String> {
        let (origin, signer) = (self.name(app).await?, signer(app)?);
        let size = self.tree.len();
        let root = self.tree.root(size).expect("a tree has its own root");
        Ok(Checkpoint { origin, size, root }.signed(signer))
    }
}

/// Reads hashes of receipts, and notes it if the stored ones are damaged.
async fn hashes(app: &App, after: i64, limit: i64) -> AppResult<Vec<Hash>> {
    let read = app.store.receipt_hashes(after, limit).await;
    if read.as_ref().is_err_and(StoreError::is_damage) {
        app.log.is_damaged.store(true, Ordering::Relaxed);
    }
    Ok(read?)
}

/// Looks for damage to the stored log and reports it to the operator; `/readyz` shows it from then on. Does not examine
/// what the receipts state: verifiers do that.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn look_for_damage(app: &App) -> AppResult<()> {
    if let Some(lack) = damage(app).await? {
        app.log.is_damaged.store(true, Ordering::Relaxed);
        metrics::counter!("plumbline_corrupt_rows_total").increment(1);
        tracing::error!(
            "the log of receipts is damaged: {lack}. What is missing cannot be proven any more, and every witness will say so. \
             Keep this database as it is, and see docs/operations.md, section Backup and copies"
        );
    }
    Ok(())
}

/// Says what the log lacks: entries in between, or what a witness has cosigned.
async fn damage(app: &App) -> AppResult<Option<String>> {
    // Read first: a cosignature of entries that come meanwhile is not compared.
    let mut cosigned = app.store.cosignatures().await?;
    cosigned.sort_by_key(|row| row.size);
    let (entries, last) = app.store.log_extent().await?;
    if entries != last {
        return Ok(Some(format!("it has {entries} entries, and the last one is number {last}")));
    }
    let mut read = Frontier::default();
    for row in cosigned {
        let Some(root) = Checkpoint::parts(&row.checkpoint).and_then(|(text, _)| Checkpoint::read(&text)) else {
            continue;
        };
        while read.size() < root.size {
            let from = read.size().cast_signed();
            let hashes = hashes(app, from, AT_ONCE.min(row.size - from)).await?;
            if hashes.is_empty() {
                return Ok(Some(format!("it has {entries} entries, and {} has cosigned {}", row.witness, row.size)));
            }
            for hash in hashes {
                read.push(leaf(&hash));
            }
        }
        if read.size() == root.size && read.root() != root.root {
            return Ok(Some(format!("its first {} entries are not those that {} has cosigned", row.size, row.witness)));
        }
    }
    Ok(None)
}

/// Returns a checkpoint of the log as it is now, as a signed note.
///
/// # Errors
/// Returns an error if this node cannot sign, or if the database fails.
pub async fn checkpoint(app: &App) -> AppResult<String> {
    let mut grown = app.log.grown.lock().await;
    grown.grow(app).await?;
    grown.checkpoint(app).await
}

/// Returns the root of the log at a given size; `None` if the log has another name or fewer entries.
///
/// # Errors
/// Returns an error if the database fails.
pub(super) async fn root_at(app: &App, origin: &str, size: u64) -> AppResult<Option<Hash>> {
    let mut grown = app.log.grown.lock().await;
    grown.grow(app).await?;
    let is_own = grown.name(app).await? == origin;
    Ok(grown.tree.root(size).filter(|_| is_own))
}

/// Returns the key that verifies checkpoints, in the form in which verifiers of notes take it.
///
/// # Errors
/// Returns an error if this node cannot sign, or if the database fails.
pub async fn key(app: &App) -> AppResult<String> {
    let name = app.log.grown.lock().await.name(app).await?;
    Ok(verifier_key(&name, signer(app)?))
}

/// Returns a tile of hashes or entries.
///
/// # Errors
/// Returns an error (404) if the path names no tile, or one that the log does not fill yet, or if the database fails.
pub async fn tile(app: &App, path: &str) -> AppResult<Vec<u8>> {
    let wanted = TileName::parse(path).ok_or_else(|| {
        AppError::not_found(format!("{path:?} names no tile: expected LEVEL/N or entries/N, such as 0/000.p/17"))
    })?;
    let mut grown = app.log.grown.lock().await;
    let read = |grown: &Grown| match wanted.level {
        Some(_) => wanted.hashes(&grown.tree),
        None => wanted.entries(&grown.entries),
    };
    if let Some(tile) = read(&grown) {
        return Ok(tile);
    }
    grown.grow(app).await?;
    let missing =
        || AppError::not_found(format!("the log of {} entries does not fill the tile {path:?}", grown.tree.len()));
    read(&grown).ok_or_else(missing)
}

/// Returns the proof that a receipt is in the log, with a checkpoint of the log that has it.
///
/// # Errors
/// Returns an error (404) if there is no such receipt, or an error if this node cannot sign, or if the database fails.
pub async fn inclusion(app: &App, seq: i64) -> AppResult<InclusionProof> {
    let mut grown = app.log.grown.lock().await;
    grown.grow(app).await?;
    let size = grown.tree.len();
    let path = u64::try_from(seq - 1).ok().and_then(|index| grown.tree.inclusion(index, size));
    let path = path.ok_or_else(|| AppError::not_found(format!("the log has no receipt {seq}")))?;
    let checkpoint = grown.checkpoint(app).await?;
    Ok(InclusionProof { size, path: path.iter().map(|hash| hex(hash)).collect(), checkpoint })
}

fn signer(app: &App) -> AppResult<&Signer> {
    let lacks = || AppError::new(Kind::NotReady, "this node lacks the secrets of the service, so it cannot sign");
    app.signer.as_deref().ok_or_else(lacks)
}
