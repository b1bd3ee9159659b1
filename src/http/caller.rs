//! Who asks: the owner of the key that a request carries.
//!
//! Reading is public. Writing and grading need a key, unless the service was started open; a key that is sent is looked at
//! all the same.

use std::collections::HashMap;
use std::sync::{PoisonError, RwLock};
use std::time::{Duration, Instant};

use axum::extract::{FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};

use super::problem::{ApiError, ApiResult};
use super::rates::{Left, Peer};
use super::state::AppState;
use crate::clock::now_ms;
use crate::store::keys::{KeyRow, Scope, parts};

/// How long a key that was found is taken for good before it is looked up again: a revoked one works no longer than this.
const TRUSTED_FOR: Duration = Duration::from_millis(500);
/// Keys held at most; a request with an unknown key is not held.
const MAX_HELD: usize = 10_000;

/// Keys that were used lately.
#[derive(Debug)]
pub struct Keys {
    held: RwLock<HashMap<String, (KeyRow, Instant)>>,
    /// Whether writing needs no key.
    pub is_open: bool,
}

/// Who asks.
#[derive(Debug, Clone)]
pub struct Caller {
    key: Option<KeyRow>,
}

impl Caller {
    /// The owner whose key it is; none where the service is open and no key was sent.
    #[must_use]
    pub fn owner(&self) -> Option<&str> {
        self.key.as_ref().map(|key| key.owner.as_str())
    }

    /// Whether they may do what has this scope.
    ///
    /// # Errors
    /// 403 where the key has it not.
    pub fn require(&self, scope: Scope) -> ApiResult<()> {
        match &self.key {
            Some(key) if !key.allows(scope) => {
                let detail = format!("the key has not the scope {:?}, which this needs", scope.name());
                Err(ApiError::new(StatusCode::FORBIDDEN, "forbidden", "Forbidden", detail))
            }
            // What an operator does stands for ever, under a name.
            None if scope == Scope::Admin => Err(unauthorized("this needs a key with the scope admin, here too")),
            _ => Ok(()),
        }
    }

    /// Whether something of this owner is theirs to change. What nobody owns is everybody's.
    ///
    /// # Errors
    /// 403 where it is another's.
    pub fn require_own(&self, owner: Option<&str>, what: &str) -> ApiResult<()> {
        let is_admin = self.key.as_ref().is_some_and(|key| key.allows(Scope::Admin));
        if owner.is_none() || is_admin || self.owner() == owner {
            return Ok(());
        }
        let detail = format!("the {what} belongs to another owner");
        Err(ApiError::new(StatusCode::FORBIDDEN, "forbidden", "Forbidden", detail))
    }
}

/// What the key of a request came to; kept with the request for the handler.
#[derive(Debug, Clone)]
enum Identified {
    Caller(Caller),
    /// Refused, and why.
    Refused(&'static str),
}

/// Looks at a request's key, and counts the request among those of its sender. Gives what they may still send.
///
/// # Errors
/// The answer, where they sent too many, or the database fails.
pub async fn identify(state: &AppState, request: &mut Request) -> ApiResult<Option<Left>> {
    let peer = request.extensions().get::<Peer>().copied();
    let (identified, left) = match bearer(request.headers()) {
        Sent::Nothing => (None, state.rates.without_key(peer, request.headers())?),
        Sent::Unreadable => {
            let refused = Identified::Refused("expected Authorization: Bearer, then the key");
            (Some(refused), state.rates.without_key(peer, request.headers())?)
        }
        Sent::Key(sent) => {
            // A key that was never found costs a read: who sends many that are none is stopped before it.
            if !state.keys.knows(sent) {
                state.rates.looking_up(peer, request.headers())?;
            }
            if let Some(key) = state.keys.live(state, sent).await? {
                let left = state.rates.with_key(&key.id)?;
                (Some(Identified::Caller(Caller { key: Some(key) })), left)
            } else {
                let refused = Identified::Refused("the key is unknown, revoked or expired");
                (Some(refused), state.rates.without_key(peer, request.headers())?)
            }
        }
    };
    if let Some(identified) = identified {
        request.extensions_mut().insert(identified);
    }
    Ok(left)
}

impl FromRequestParts<AppState> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(request: &mut Parts, state: &AppState) -> ApiResult<Self> {
        match request.extensions.remove::<Identified>() {
            Some(Identified::Caller(caller)) => Ok(caller),
            Some(Identified::Refused(why)) => Err(unauthorized(why)),
            None if state.keys.is_open => Ok(Self { key: None }),
            None => Err(unauthorized("this needs a key: Authorization: Bearer …; reading needs none")),
        }
    }
}

impl Keys {
    /// None held yet.
    #[must_use]
    pub fn new(is_open: bool) -> Self {
        Self { held: RwLock::default(), is_open }
    }

    /// Whether a key of this public part was found before.
    fn knows(&self, sent: &str) -> bool {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        parts(sent).is_some_and(|(id, _)| held.contains_key(id))
    }

    fn held(&self, id: &str) -> Option<KeyRow> {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        held.get(id).filter(|(_, since)| since.elapsed() < TRUSTED_FOR).map(|(key, _)| key.clone())
    }

    /// The key that was sent, where it is one that may be used now.
    async fn live(&self, state: &AppState, sent: &str) -> ApiResult<Option<KeyRow>> {
        let Some((id, secret)) = parts(sent) else { return Ok(None) };
        let is_live = |key: &KeyRow| key.has_secret(secret) && key.is_live(now_ms());
        if let Some(key) = self.held(id) {
            return Ok(Some(key).filter(is_live));
        }
        let Some(key) = state.store.key(id).await?.filter(is_live) else { return Ok(None) };
        state.store.note_key_use(&key, now_ms()).await?;
        let mut held = self.held.write().unwrap_or_else(PoisonError::into_inner);
        if held.len() >= MAX_HELD {
            held.clear();
        }
        held.insert(id.to_owned(), (key.clone(), Instant::now()));
        Ok(Some(key))
    }
}

/// What a request says about a key.
enum Sent<'h> {
    Nothing,
    Unreadable,
    Key(&'h str),
}

fn bearer(headers: &HeaderMap) -> Sent<'_> {
    let Some(value) = headers.get(header::AUTHORIZATION) else { return Sent::Nothing };
    match value.to_str().unwrap_or_default().split_once(' ') {
        Some((scheme, key)) if scheme.eq_ignore_ascii_case("bearer") => Sent::Key(key.trim()),
        _ => Sent::Unreadable,
    }
}

fn unauthorized(detail: &str) -> ApiError {
    ApiError::new(StatusCode::UNAUTHORIZED, "unauthorized", "Unauthorized", detail)
}
