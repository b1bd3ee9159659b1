//! Access: identifies callers and decides what they may do.
//!
//! Reading is public. Writing and grading need a key, unless the service was started open or open for grading. A key
//! that is sent is looked up in any case.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::now_ms;
use crate::store::keys::{KeyRow, Scope, parts};
use crate::store::location::Location;
use crate::store::{Store, StoreResult};

/// Time for which a key is trusted before it is looked up again; a revoked key works no longer than this.
const TRUSTED_FOR: Duration = Duration::from_millis(500);
/// Least interval between two records of the use of a key, in milliseconds.
const USE_NOTED_EVERY_MS: i64 = 60_000;
/// Maximum number of keys held in memory; unknown keys are not held.
const MAX_HELD: usize = 10_000;

/// Recently used keys.
#[derive(Debug)]
pub struct Keys {
    held: RwLock<HashMap<String, (KeyRow, Instant)>>,
    /// Last uses of keys that are not stored yet, by public part.
    uses: Mutex<HashMap<String, i64>>,
    /// Requests that are allowed without a key.
    pub open: Openness,
}

/// Requests that are allowed without a key, in addition to reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Openness {
    /// None: everything else needs a key.
    Keyed,
    /// Grading within a request, which stores nothing.
    Grading,
    /// All except what an operator does.
    Open,
}

/// Sender of a request.
#[derive(Debug, Clone)]
pub struct Caller {
    /// Live key that was sent, if any.
    pub key: Option<KeyRow>,
    /// Requests that this service allows without a key.
    pub open: Openness,
    /// Reason why the key that was sent is not accepted.
    pub refused: Option<&'static str>,
    /// Sender whose share of the service the request uses.
    pub who: Arc<str>,
}

impl Caller {
    /// Returns the sender whose share of the service a request uses: the owner of its key, or else the address.
    #[must_use]
    pub const fn who(&self) -> &Arc<str> {
        &self.who
    }

    /// Returns the owner of the key; none if the service is open and no key was sent.
    #[must_use]
    pub fn owner(&self) -> Option<&str> {
        self.key.as_ref().map(|key| key.owner.as_str())
    }

    /// Checks that the caller may do what needs this scope.
    ///
    /// # Errors
    /// Returns 403 if the key lacks the scope, and 401 if this needs a key and none was accepted.
    pub fn require(&self, scope: Scope) -> AppResult<()> {
        match &self.key {
            Some(key) if !key.allows(scope) => {
                let detail = format!("the key lacks the scope {:?}, which this needs", scope.name());
                Err(AppError::new(Kind::Forbidden, detail))
            }
            // Actions of an operator are recorded permanently under a name, so they always need a key.
            None if scope == Scope::Admin => Err(unauthorized(
                self.refused.unwrap_or("this needs a key with the scope admin, even on an open service"),
            )),
            None if self.open == Openness::Grading && !matches!(scope, Scope::Grade | Scope::Read) => Err(
                unauthorized(self.refused.unwrap_or("this needs a key: Authorization: Bearer …; grading needs none")),
            ),
            _ => Ok(()),
        }
    }

    /// Returns whether something of this owner is the caller's, or the caller is the operator.
    #[must_use]
    pub fn owns(&self, owner: Option<&str>) -> bool {
        let is_admin = self.key.as_ref().is_some_and(|key| key.allows(Scope::Admin));
        is_admin || (owner.is_some() && self.owner() == owner)
    }

    /// Returns whether the caller sees what is kept from others about something of this owner. Keys that only grade and
    /// read may stand in URLs, so they do not.
    #[must_use]
    pub fn sees_all_of(&self, owner: Option<&str>) -> bool {
        self.owns(owner) && self.key.as_ref().is_some_and(|key| key.allows(Scope::Submit))
    }

    /// Checks that the caller may change something of this owner. Anyone may change what has no owner.
    ///
    /// # Errors
    /// Returns 403 if it belongs to another owner.
    pub fn require_own(&self, owner: Option<&str>, what: &str) -> AppResult<()> {
        if owner.is_none() || self.owns(owner) {
            return Ok(());
        }
        let detail = format!("the {what} belongs to another owner");
        Err(AppError::new(Kind::Forbidden, detail))
    }
}

impl App {
    /// Returns the key that was sent, if it may be used now.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn live_key(&self, sent: &str) -> AppResult<Option<KeyRow>> {
        self.keys.live(&self.store, sent).await
    }

    /// Returns whether this node knows the keys of the service; one without a database knows none.
    #[must_use]
    pub fn keeps_keys(&self) -> bool {
        !matches!(self.store.location(), Location::Memory)
    }

    /// Stores the last uses of keys in one transaction. Requests never wait for this.
    ///
    /// # Errors
    /// Returns an error if the database fails; the next call tries again.
    pub async fn store_key_uses(&self) -> StoreResult<()> {
        self.keys.store_uses(&self.store).await
    }
}

impl Keys {
    /// Creates an empty cache of keys.
    #[must_use]
    pub fn new(open: Openness) -> Self {
        Self { held: RwLock::default(), uses: Mutex::default(), open }
    }

    /// Returns whether the key with this public part was found before.
    #[must_use]
    pub fn knows(&self, sent: &str) -> bool {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        parts(sent).is_some_and(|(id, _)| held.contains_key(id))
    }

    fn held(&self, id: &str) -> Option<KeyRow> {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        held.get(id).filter(|(_, since)| since.elapsed() < TRUSTED_FOR).map(|(key, _)| key.clone())
    }

    async fn store_uses(&self, store: &Store) -> StoreResult<()> {
        let uses: Vec<(String, i64)> =
            self.uses.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(id, at)| (id.clone(), *at)).collect();
        if uses.is_empty() {
            return Ok(());
        }
        store.note_key_uses(&uses).await?;
        let mut all = self.uses.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|id, at| !uses.iter().any(|(stored, stored_at)| stored == id && stored_at == at));
        Ok(())
    }

    async fn live(&self, store: &Store, sent: &str) -> AppResult<Option<KeyRow>> {
        let Some((id, secret)) = parts(sent) else { return Ok(None) };
        let is_live = |key: &KeyRow| key.has_secret(secret) && key.is_live(now_ms());
        if let Some(key) = self.held(id) {
            return Ok(Some(key).filter(is_live));
        }
        let Some(key) = store.key(id).await?.filter(is_live) else { return Ok(None) };
        if key.last_used_at_ms.is_none_or(|last| now_ms() - last >= USE_NOTED_EVERY_MS) {
            self.uses.lock().unwrap_or_else(PoisonError::into_inner).insert(id.to_owned(), now_ms());
        }
        let mut held = self.held.write().unwrap_or_else(PoisonError::into_inner);
        if held.len() >= MAX_HELD {
            held.clear();
        }
        held.insert(id.to_owned(), (key.clone(), Instant::now()));
        Ok(Some(key))
    }
}

/// Creates the refusal of a request that needs a key.
#[must_use]
pub fn unauthorized(detail: &str) -> AppError {
    AppError::new(Kind::Unauthorized, detail)
}
