//! Cosignatures of the log: the latest of each witness.

use super::db::{query, query_as};
use super::rows::from_row;
use super::{Store, StoreResult, commit};

/// The latest cosignature of a witness.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CosignatureRow {
    /// Key of the witness: name, identifier and key.
    pub witness: String,
    /// Number of entries of the log.
    pub size: i64,
    /// The checkpoint, as the log signed it.
    pub checkpoint: String,
    /// The line of the cosignature.
    pub line: String,
    /// Time of the cosignature, in seconds since 1970.
    pub at_s: i64,
}

from_row!(CosignatureRow { witness, size, checkpoint, line, at_s });

impl Store {
    /// Stores the cosignature of a witness, unless a later one is stored.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn put_cosignature(&self, new: &CosignatureRow) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query(
            "INSERT INTO cosignatures (witness, size, checkpoint, line, at_s) VALUES ($1, $2, $3, $4, $5)
             ON CONFLICT (witness) DO UPDATE SET size = excluded.size, checkpoint = excluded.checkpoint,
                line = excluded.line, at_s = excluded.at_s
             WHERE (excluded.size, excluded.at_s) > (cosignatures.size, cosignatures.at_s)",
        )
        .bind(&new.witness)
        .bind(new.size)
        .bind(&new.checkpoint)
        .bind(&new.line)
        .bind(new.at_s)
        .execute(&mut tx)
        .await?;
        commit(tx, "put_cosignature").await
    }

    /// Returns the latest cosignature of each witness, those of the longest log first.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn cosignatures(&self) -> StoreResult<Vec<CosignatureRow>> {
        query_as("SELECT witness, size, checkpoint, line, at_s FROM cosignatures ORDER BY size DESC, witness")
            .fetch_all(&self.readers)
            .await
    }
}
