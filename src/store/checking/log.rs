//! The public log against what else the database has of it: receipts that were handed out, cosignatures, and epochs that
//! it announces.

use std::collections::{BTreeMap, HashSet};

use sha2::{Digest as _, Sha256};

use super::{Check, Found};
use crate::store::StoreResult;
use crate::store::db::{query_as, query_scalar};
use plumbline_engine::hidden::announcements::{Announcement, announcement};
use plumbline_engine::hidden::canonical::canonical_json;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::verify_signature;
use plumbline_engine::tasks::hex;

/// Receipts that entrants were given, by table.
const HANDED_OUT: [(&str, &str); 2] = [
    ("entries", "SELECT id, receipt FROM entries WHERE receipt IS NOT NULL ORDER BY id"),
    ("instances", "SELECT id, receipt FROM instances WHERE receipt IS NOT NULL ORDER BY id"),
];

impl Check<'_> {
    /// Compares the log with what was handed out, cosigned and announced.
    pub(super) async fn log(&mut self) {
        self.handed_out().await;
        if let Err(error) = self.cosigned().await {
            (self.tell)(Found::of("cosignatures".to_owned(), &error));
        }
        if let Err(error) = self.announced().await {
            (self.tell)(Found::of("epochs".to_owned(), &error));
        }
    }

    /// Verifies each receipt that an entrant was given, and that the log has it or will have it.
    async fn handed_out(&mut self) {
        let sql = "SELECT hash FROM receipts WHERE epoch_id IS NOT NULL UNION ALL SELECT hash FROM pending_receipts";
        let known: StoreResult<Vec<String>> = query_scalar(sql).fetch_all(&mut self.moment).await;
        let known: HashSet<String> = match known {
            Ok(hashes) => hashes.into_iter().collect(),
            // Reading the receipts tells what is wrong with them.
            Err(_) => return,
        };
        for (table, sql) in HANDED_OUT {
            self.rows(table, sql, async |row, _, _| {
                let given: GivenReceipt = match serde_json::from_str(row.get(1)?) {
                    Ok(given) => given,
                    Err(error) => return Ok(Some(format!("its receipt cannot be read: {error}"))),
                };
                if verify_signature(&given.receipt, &given.public_key, &given.signature).is_err() {
                    return Ok(Some("its receipt has no valid signature".to_owned()));
                }
                let hash = hex(&Sha256::digest(canonical_json(&given.receipt)));
                Ok((!known.contains(&hash)).then(|| "its receipt is missing from the log".to_owned()))
            })
            .await;
        }
    }

    /// Checks that the log has all entries that witnesses have cosigned.
    async fn cosigned(&mut self) -> StoreResult<()> {
        let length: i64 =
            query_scalar("SELECT COALESCE(MAX(seq), 0) FROM receipts").fetch_one(&mut self.moment).await?;
        let sql = "SELECT witness, size FROM cosignatures WHERE size > $1 ORDER BY witness";
        let longer: Vec<(String, i64)> = query_as(sql).bind(length).fetch_all(&mut self.moment).await?;
        for (witness, size) in longer {
            let detail = format!("it is of {size} receipts, and the log has {length}: the end of the log is missing");
            (self.tell)(Found::damaged(format!("cosignatures {witness}"), detail));
        }
        Ok(())
    }

    /// Compares each epoch with its announcement in the log.
    async fn announced(&mut self) -> StoreResult<()> {
        let sql = "SELECT id, commitment FROM epochs";
        let stored: Vec<(String, String)> = query_as(sql).fetch_all(&mut self.moment).await?;
        let mut epochs = BTreeMap::new();
        for (id, commitment) in stored {
            match serde_json::from_str::<Commitment>(&commitment) {
                Ok(commitment) => drop(epochs.insert(id, Some(commitment))),
                Err(error) => {
                    (self.tell)(Found::damaged(format!("epochs {id}"), error.to_string()));
                    epochs.insert(id, None);
                }
            }
        }
        let sql = "SELECT body FROM receipts WHERE submission_id IS NULL AND epoch_id IS NULL ORDER BY seq";
        let bodies: Vec<String> = query_scalar(sql).fetch_all(&mut self.moment).await?;
        for told in bodies.iter().filter_map(|body| announcement(&serde_json::from_str(body).ok()?)) {
            let Announcement::Epoch(told) = told else { continue };
            let detail = match epochs.get(&told.commitment.epoch) {
                None => "the log announces it, and it is missing",
                Some(Some(stored)) if *stored != *told.commitment => {
                    "its commitment is not the one that the log announces"
                }
                Some(_) => continue,
            };
            (self.tell)(Found::damaged(format!("epochs {}", told.commitment.epoch), detail.to_owned()));
        }
        Ok(())
    }
}
