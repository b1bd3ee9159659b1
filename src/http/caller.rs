//! Who asks: the owner of the key that a request carries.
//!
//! Reading is public. Writing and grading need a key, unless the service was started open; a key that is sent is looked at
//! all the same.

use std::collections::HashMap;
use std::sync::{PoisonError, RwLock};
use std::time::{Duration, Instant};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};

use super::problem::{ApiError, ApiResult};
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

impl FromRequestParts<AppState> for Caller {
    type Rejection = ApiError;

    async fn from_request_parts(request: &mut Parts, state: &AppState) -> ApiResult<Self> {
        let Some(sent) = bearer(&request.headers)? else {
            if state.keys.is_open {
                return Ok(Self { key: None });
            }
            return Err(unauthorized("this needs a key: Authorization: Bearer …; reading needs none"));
        };
        let unknown = || unauthorized("the key is unknown, revoked or expired");
        let (id, secret) = parts(sent).ok_or_else(unknown)?;
        let key = state.keys.find(state, id).await?.ok_or_else(unknown)?;
        if !key.has_secret(secret) || !key.is_live(now_ms()) {
            return Err(unknown());
        }
        Ok(Self { key: Some(key) })
    }
}

impl Keys {
    /// None held yet.
    #[must_use]
    pub fn new(is_open: bool) -> Self {
        Self { held: RwLock::default(), is_open }
    }

    async fn find(&self, state: &AppState, id: &str) -> ApiResult<Option<KeyRow>> {
        if let Some((key, since)) = self.held.read().unwrap_or_else(PoisonError::into_inner).get(id)
            && since.elapsed() < TRUSTED_FOR
        {
            return Ok(Some(key.clone()));
        }
        let Some(key) = state.store.key(id).await? else { return Ok(None) };
        state.store.note_key_use(&key, now_ms()).await?;
        let mut held = self.held.write().unwrap_or_else(PoisonError::into_inner);
        if held.len() >= MAX_HELD {
            held.clear();
        }
        held.insert(id.to_owned(), (key.clone(), Instant::now()));
        Ok(Some(key))
    }
}

fn bearer(headers: &HeaderMap) -> ApiResult<Option<&str>> {
    let Some(value) = headers.get(header::AUTHORIZATION) else { return Ok(None) };
    let text = value.to_str().unwrap_or_default();
    match text.split_once(' ') {
        Some((scheme, key)) if scheme.eq_ignore_ascii_case("bearer") => Ok(Some(key.trim())),
        _ => Err(unauthorized("expected Authorization: Bearer, then the key")),
    }
}

fn unauthorized(detail: &str) -> ApiError {
    ApiError::new(StatusCode::UNAUTHORIZED, "unauthorized", "Unauthorized", detail)
}
