//! The key that signs receipts: where it comes from, and what the operator is told about it.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};

use crate::clock::now_ms;
use crate::store::location::Location;
use crate::store::secrets::Secrets;
use crate::store::{Store, schema};
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::text::agreeing;

/// Key that signs receipts.
#[derive(Debug)]
pub struct Signing {
    /// Signs receipts; none on a node that lacks the secrets.
    pub signer: Option<Arc<Signer>>,
    /// Public key that verifies what the service signs.
    pub public_key: String,
    /// Notice for the operator.
    pub notice: Option<String>,
}

/// What is known of other processes that serve the database.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Others {
    /// Another process serves the file.
    Serve,
    /// None serves the file; of the nodes of a server, the server knows.
    None,
    /// This is a command, beside which a process may serve.
    MaySign,
}

/// Loads the key, or makes it on first use. All that sign for one database sign with the same key.
///
/// # Errors
/// Returns an error if the key cannot be loaded, or if the folder does not hold the key that receipts were signed with
/// last, unless `replaces` says that a new key holds from now on. Then it returns an error if others run, which would go
/// on signing with the old key, and break the log of receipts for ever.
pub async fn signing(store: &Store, replaces: bool, others: Others) -> anyhow::Result<Signing> {
    if matches!(store.location(), Location::Server(_)) {
        let folder = store.secrets().folder().display().to_string();
        let agreed = store.agree_on_receipt_key(None, false).await?;
        // Nodes agree on nothing before the first of them starts, also when receipts came from a SQLite file.
        let held = if agreed.is_none() { store.used_receipt_keys().await?.pop() } else { agreed };
        if replaces && held.is_some() && held != own_key(store)? {
            let others = others_after_a_moment(store).await?;
            if others > 0 {
                bail!("{}", still_signs(&agreeing(others, "other node is", "other nodes are")));
            }
        }
        if !store.secrets().has_signer()? {
            if let Some(public_key) = held.clone().filter(|_| !replaces) {
                let notice = format!(
                    "this node lacks the secrets of the service: it grades no submissions, issues no hidden \
                     instances, and takes no actions on boards. Share the folder of another node, which holds receipts.key, as {folder} (--secrets). If no \
                     node has it any more, start one with --new-receipt-key. Start this node again then"
                );
                return Ok(Signing { signer: None, public_key, notice: Some(notice) });
            }
            store.secrets().signer().context("cannot make the key that signs receipts")?;
        }
        let own = store.signer().context("cannot load the key that signs receipts")?.public_key();
        let held = match held.filter(|held| !replaces && *held != own) {
            Some(held) => Some(held),
            None => store.agree_on_receipt_key(Some(&own), replaces).await?,
        };
        if let Some(held) = held.filter(|held| *held != own) {
            bail!(
                "{folder} holds the receipt key {own}, but the nodes of this database sign with {held}. Give this node \
                 the folder of the others (--secrets). If their key is lost, start with --new-receipt-key: the log of \
                 receipts then notes the change"
            );
        }
    }
    // Before a key is made where one is missing.
    let own = own_key(store)?;
    if let Some(used) = store.used_receipt_keys().await?.into_iter().find(|used| Some(used) != own.as_ref()) {
        let folder = store.secrets().folder().display().to_string();
        match others {
            Others::Serve if replaces => bail!("{}", still_signs("another process that serves the file is")),
            // The nodes of a server have agreed on the new key above.
            Others::None if replaces || matches!(store.location(), Location::Server(_)) => {}
            Others::Serve | Others::None => bail!(
                "{folder} does not hold the key {used}, with which receipts of this database were signed. Name the folder \
                 that holds it (--secrets), or put its receipts.key into this one. If the key is lost, start with serve \
                 --new-receipt-key: the log of receipts then notes the change"
            ),
            Others::MaySign => bail!(
                "{folder} does not hold the key {used}, with which receipts of this database were signed. Name the folder \
                 that holds it (--secrets), or put its receipts.key into this one. If the key is lost, start the service \
                 with --new-receipt-key first"
            ),
        }
    }
    let signer = store.signer().context("cannot load the key that signs receipts")?;
    let before = store.note_receipt_key(&signer, now_ms()).await?;
    let public_key = signer.public_key();
    let notice = before.map(|before| {
        format!(
            "receipts are signed with a new key from now on: {public_key}; the key before was {before}. The change is \
             recorded in the log at /v1/receipts. Tell the witnesses: they follow the log with --new-log-key and what /log/key \
             shows now, or after a backup was restored with a new --state"
        )
    });
    Ok(Signing { signer: Some(signer), public_key, notice })
}

/// Returns the public key in the folder of secrets; `None` if it has no key.
fn own_key(store: &Store) -> anyhow::Result<Option<String>> {
    let has_key = store.secrets().has_signer()?;
    let key =
        has_key.then(|| store.secrets().signer()).transpose().context("cannot load the key that signs receipts")?;
    Ok(key.map(|key| key.public_key()))
}

/// Returns how many other nodes are connected to the server. It takes a moment to notice that one was killed.
async fn others_after_a_moment(store: &Store) -> anyhow::Result<i64> {
    const LOOKS: u32 = 10;
    for _ in 1..LOOKS {
        if store.other_nodes().await? == 0 {
            return Ok(0);
        }
        tokio::time::sleep(Duration::from_millis(300)).await;
    }
    Ok(store.other_nodes().await?)
}

/// Says why a new key is refused while other processes run.
fn still_signs(others: &str) -> String {
    format!(
        "{others} running, and would go on signing receipts with the old key, which breaks their log for ever: stop all of \
         them before you start one with a new receipt key"
    )
}

/// Refuses to begin a new database where the keys of one are: its log would have the name and the key of the one before,
/// and be another history.
///
/// # Errors
/// Returns an error that says what to do, if there are keys and no database.
pub async fn refuse_to_begin_anew(database: &Location, secrets: Option<&Path>) -> anyhow::Result<()> {
    if matches!(database, Location::Memory | Location::Unreadable(_)) {
        return Ok(());
    }
    let folder = secrets.map_or_else(|| database.default_secrets(), Path::to_owned);
    // A node makes keys once its database has tables, so those of a node that starts at the same time are read before.
    if !Secrets::in_folder(folder.clone()).holds_keys()? {
        return Ok(());
    }
    let (is_none, remedy) = match database {
        // A file that was cut off has a name and nothing else.
        Location::File(file) => (
            std::fs::metadata(file).map_or(true, |found| found.is_file() && found.len() == 0),
            "put it back (plumbline restore)",
        ),
        // A server that cannot be reached is told when the database is opened.
        _ => (
            schema::state(database).await.is_ok_and(|state| state.found == 0),
            "name the one that they belong to, or restore it from a dump",
        ),
    };
    if !is_none {
        return Ok(());
    }
    bail!(
        "the database {database} is missing or empty, but {} holds the keys of one. If it was moved or lost, {remedy}. To \
         begin a new one, move that folder away first (--secrets names another): a new log under the old key would be a \
         second history",
        folder.display()
    )
}
