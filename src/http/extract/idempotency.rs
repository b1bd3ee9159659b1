//! `Idempotency-Key`: carries out a request that creates something only once, even if it is sent repeatedly.

use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use sha2::{Digest as _, Sha256};

use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::store::idempotency::IdempotencyKey;
use plumbline_engine::tasks::hex;

const HEADER: &str = "idempotency-key";
/// Header of a response that repeats an earlier one.
pub const REPLAYED: (HeaderName, HeaderValue) =
    (HeaderName::from_static("idempotency-replayed"), HeaderValue::from_static("true"));

/// Requests with an idempotency key that are being processed.
#[derive(Debug, Default)]
pub struct InFlight {
    keys: Mutex<HashSet<(String, String)>>,
}

/// A request with an idempotency key, held while it is being processed.
#[derive(Debug)]
pub struct Underway {
    /// Owner, key and hash of the request.
    pub once: IdempotencyKey,
    all: Arc<InFlight>,
}

impl Drop for Underway {
    fn drop(&mut self) {
        let mut keys = self.all.keys.lock().unwrap_or_else(PoisonError::into_inner);
        keys.remove(&(self.once.owner.clone(), self.once.key.clone()));
    }
}

impl InFlight {
    /// Registers a request if it has an idempotency key; otherwise returns `None`.
    ///
    /// # Errors
    /// Returns an error if the key is invalid (400) or a request with the same key is being processed (409).
    pub fn begin(
        self: &Arc<Self>,
        headers: &HeaderMap,
        caller: &Caller,
        operation: &str,
        body: &[u8],
    ) -> AppResult<Option<Underway>> {
        let Some(value) = headers.get(HEADER) else { return Ok(None) };
        let key = value.to_str().unwrap_or_default().trim();
        if key.is_empty() || key.len() > LIMITS.idempotency_key_bytes {
            let detail = format!("Idempotency-Key: expected 1 to {} visible characters", LIMITS.idempotency_key_bytes);
            return Err(AppError::new(Kind::BadRequest, detail));
        }
        let body_hash = hex(&Sha256::new().chain_update(operation).chain_update([0]).chain_update(body).finalize());
        let once =
            IdempotencyKey { owner: caller.owner().unwrap_or_default().to_owned(), key: key.to_owned(), body_hash };
        let mut keys = self.keys.lock().unwrap_or_else(PoisonError::into_inner);
        if !keys.insert((once.owner.clone(), once.key.clone())) {
            let detail =
                "a request with this Idempotency-Key is still being processed; send the request again in a moment";
            return Err(AppError::conflict("idempotency-in-flight", detail).retry_after(1));
        }
        drop(keys);
        Ok(Some(Underway { once, all: Arc::clone(self) }))
    }
}
