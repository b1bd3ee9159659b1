//! Keys: those in the folder of secrets, compared with what they signed or are committed to.

use super::{Check, Found, FoundKind};
use crate::store::StoreResult;
use crate::store::db::{query_as, query_scalar};
use crate::store::secrets::Secrets;
use plumbline_engine::hidden::commitment::Commitment;

impl Check<'_> {
    /// Tells which keys are not in the folder of secrets, or are others than they should be.
    pub(super) async fn keys(&mut self, secrets: &Secrets) {
        let commitments = query_as("SELECT id, commitment FROM epochs ORDER BY id").fetch_all(&mut self.moment).await;
        let commitments: Vec<(String, String)> = commitments.unwrap_or_else(|error| {
            (self.tell)(Found::of("epochs".to_owned(), &error));
            Vec::new()
        });
        for (id, commitment) in commitments {
            match serde_json::from_str(&commitment) {
                Ok(commitment) => self.epoch_key(secrets, &commitment),
                Err(error) => (self.tell)(Found::damaged(format!("epochs {id}"), error.to_string())),
            }
        }
        let used = query_scalar("SELECT public_key FROM receipts ORDER BY seq DESC LIMIT 1");
        let used: StoreResult<Option<String>> = used.fetch_optional(&mut self.moment).await;
        match used {
            Ok(Some(used)) => self.receipt_key(secrets, &used),
            Ok(None) => {}
            Err(error) => (self.tell)(Found::of("receipts".to_owned(), &error)),
        }
    }

    fn epoch_key(&mut self, secrets: &Secrets, commitment: &Commitment) {
        let id = &commitment.epoch;
        let place = format!("{}/epoch-{id}.json", secrets.folder().display());
        (self.tell)(match secrets.epoch(commitment, None) {
            Ok(Some(_)) => return,
            Ok(None) if !secrets.has_epoch(id) => {
                Found { kind: FoundKind::Missing, place, detail: format!("the key of epoch {id} is not there") }
            }
            Ok(None) => Found::damaged(place, format!("it is damaged, or not the key that epoch {id} is committed to")),
            Err(error) => Found::unreached(place, &error),
        });
    }

    /// Compares the key in the folder of secrets with the public key that verifies the last receipt.
    fn receipt_key(&mut self, secrets: &Secrets, used: &str) {
        let place = format!("{}/receipts.key", secrets.folder().display());
        let missing = |place, detail| Found { kind: FoundKind::Missing, place, detail };
        (self.tell)(match secrets.has_signer() {
            Err(error) => Found::unreached(place, &error),
            Ok(false) => missing(place, format!("the key that signed the last receipt, {used}, is not there")),
            Ok(true) => match secrets.signer() {
                Ok(signer) if signer.public_key() == used => return,
                Ok(_) => missing(place, format!("it is another key than {used}, which signed the last receipt")),
                Err(error) => Found::damaged(place, error.to_string()),
            },
        });
    }
}
