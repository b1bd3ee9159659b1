//! Identifies the caller of a request: the owner of its key, or the address that it comes from.
//!
//! Clients that cannot send headers may put a key into the path (`/with-key/KEY/…`). Such a key may only allow grading
//! and reading, and is never logged.

use std::sync::Arc;

use axum::extract::{FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use axum_extra::extract::CookieJar;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use crate::app::access::{Caller, Openness, unauthorized};
use crate::app::error::{AppError, AppResult};
use crate::http::middleware::rates::{Peer, RateLimitStatus, RateLimited};
use crate::http::state::AppState;
use crate::store::keys::{KeyRow, Scope, has_form};

/// Result of looking up the key of a request, passed to the handler as a request extension.
#[derive(Debug, Clone)]
enum Identified {
    Key(KeyRow),
    /// The key is invalid, for this reason.
    Refused(&'static str),
    /// What was sent has the form of a key of this service, but is not a live key.
    NotLive,
}

/// Reason for refusing a key that is not live.
const NOT_LIVE: &str = "the key is unknown, revoked or expired";

/// Sender of a request, as identified by its key.
#[derive(Debug, Clone, Default)]
pub struct Sender {
    /// State of the sender's rate limit; `None` if there is no limit.
    pub left: Option<RateLimitStatus>,
    /// Owner of the key.
    pub owner: Option<String>,
    /// Reason why the key is invalid.
    pub refused: Option<&'static str>,
}

/// Prefix of paths that contain a key.
pub const KEY_PREFIX: &str = "/with-key/";
/// Path of the page of operators, and the beginning of the paths of its forms.
pub const MODERATION: &str = "/moderation";
/// Cookie with the key of an operator; it counts only for that page.
pub const KEY_COOKIE: &str = "plumbline_key";
/// Paths for health probes and metrics collectors, which have no rate limit.
pub const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Returns a path that is safe to show and log: an ellipsis replaces the key in it.
#[must_use]
pub fn without_key(path: &str) -> String {
    match path.strip_prefix(KEY_PREFIX) {
        Some(rest) => format!("{KEY_PREFIX}…{}", rest.find('/').map_or("", |at| &rest[at..])),
        None => path.to_owned(),
    }
}

/// Identifies the sender of a request by its key and counts the request towards the sender's rate limit.
///
/// # Errors
/// Returns the response to send if the sender exceeds the rate limit or the database fails.
pub async fn identify(state: &AppState, request: &mut Request) -> Result<Sender, RateLimited> {
    if PROBES.contains(&request.uri().path()) {
        return Ok(Sender::default());
    }
    let peer = request.extensions().get::<Peer>().copied();
    let is_in_path = request.uri().path().starts_with(KEY_PREFIX);
    let sent = match request.uri().path() {
        path if is_in_path => in_path(path),
        path if path.starts_with(MODERATION) => in_cookie(request.headers()),
        _ => in_headers(request.headers()),
    };
    let (identified, left) = match sent {
        Sent::Nothing => (None, state.rates.without_key(peer, request.headers())?),
        Sent::Unreadable => {
            let refused = Identified::Refused("expected Authorization: Bearer, followed by the key");
            (Some(refused), state.rates.without_key(peer, request.headers())?)
        }
        Sent::Key(sent) => {
            // Looking up an unknown key reads the database, so these lookups have a rate limit of their own.
            if !state.keys.knows(&sent) {
                state.rates.looking_up(peer, request.headers())?;
            }
            match state.live_key(&sent).await? {
                Some(key)
                    if is_in_path && key.scopes.iter().any(|scope| !matches!(scope, Scope::Grade | Scope::Read)) =>
                {
                    let left = state.rates.with_key(&key.owner)?;
                    let why = "a key in a path may only have the scopes grade and read, because URLs are logged in many places: \
                               create one with --scopes grade";
                    (Some(Identified::Refused(why)), left)
                }
                Some(key) => {
                    let left = state.rates.with_key(&key.owner)?;
                    (Some(Identified::Key(key)), left)
                }
                None => {
                    // A node without a database knows no key, and serves everybody.
                    let is_meant = has_form(&sent) && state.keeps_keys();
                    let refused = if is_meant { Identified::NotLive } else { Identified::Refused(NOT_LIVE) };
                    (Some(refused), state.rates.without_key(peer, request.headers())?)
                }
            }
        }
    };
    let mut sender = Sender { left, ..Sender::default() };
    match &identified {
        Some(Identified::Key(key)) => sender.owner = Some(key.owner.clone()),
        Some(Identified::Refused(why)) => sender.refused = Some(why),
        Some(Identified::NotLive) => sender.refused = Some(NOT_LIVE),
        None => {}
    }
    if let Some(identified) = identified {
        request.extensions_mut().insert(identified);
    }
    Ok(sender)
}

/// Sender of a request that needs no key, for fair sharing: the owner of the key if one was sent, otherwise the
/// address.
#[derive(Debug, Clone)]
pub struct Reader(pub Arc<str>);

impl FromRequestParts<AppState> for Reader {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(request: &mut Parts, state: &AppState) -> Result<Self, Self::Rejection> {
        let who = match request.extensions.get::<Identified>() {
            Some(Identified::Key(key)) => format!("owner {}", key.owner),
            _ => address_of(request, state),
        };
        Ok(Self(Arc::from(who)))
    }
}

fn address_of(request: &Parts, state: &AppState) -> String {
    let peer = request.extensions.get::<Peer>().copied();
    let address = state.rates.address(peer, &request.headers);
    address.map_or_else(|| "nobody".to_owned(), |address| format!("address {address}"))
}

impl FromRequestParts<AppState> for Caller {
    type Rejection = AppError;

    async fn from_request_parts(request: &mut Parts, state: &AppState) -> AppResult<Self> {
        let open = state.keys.open;
        let is_in_path = request.uri.path().starts_with(KEY_PREFIX);
        let identified = request.extensions.remove::<Identified>();
        let who = match &identified {
            Some(Identified::Key(key)) => format!("owner {}", key.owner),
            _ => address_of(request, state),
        };
        let who = Arc::from(who);
        match identified {
            Some(Identified::Key(key)) => Ok(Self { key: Some(key), open, refused: None, who }),
            // Whoever sends a key that was revoked, or is misspelt, wants its owner, not nobody, and may not do more than
            // with the key.
            Some(Identified::NotLive) => Err(unauthorized(NOT_LIVE)),
            // Other programs send a word of their own where no key is needed: the request is served without it, and a
            // response header says so. A key in the path was put there deliberately, so the request is rejected.
            Some(Identified::Refused(why)) if open != Openness::Keyed && !is_in_path => {
                Ok(Self { key: None, open, refused: Some(why), who })
            }
            Some(Identified::Refused(why)) => Err(unauthorized(why)),
            None if open != Openness::Keyed => Ok(Self { key: None, open, refused: None, who }),
            None => Err(unauthorized("this needs a key: Authorization: Bearer …")),
        }
    }
}

/// Key that a request carries, not yet looked up.
enum Sent {
    Nothing,
    Unreadable,
    Key(String),
}

/// Reads the key from the `Authorization` header: after `Bearer`, or as user name or password of `Basic`, which is what
/// clients send for a URL with `key@`.
fn in_headers(headers: &HeaderMap) -> Sent {
    let Some(value) = headers.get(header::AUTHORIZATION) else { return Sent::Nothing };
    match value.to_str().unwrap_or_default().split_once(' ') {
        Some((scheme, key)) if scheme.eq_ignore_ascii_case("bearer") => Sent::Key(key.trim().to_owned()),
        Some((scheme, pair)) if scheme.eq_ignore_ascii_case("basic") => {
            let decoded = BASE64_STANDARD.decode(pair.trim()).ok().and_then(|bytes| String::from_utf8(bytes).ok());
            let key = decoded.as_deref().and_then(|pair| pair.split(':').find(|part| has_form(part)));
            key.map_or(Sent::Unreadable, |key| Sent::Key(key.to_owned()))
        }
        // The word before the key is easily forgotten.
        None if value.to_str().is_ok_and(has_form) => Sent::Key(value.to_str().unwrap_or_default().to_owned()),
        _ => Sent::Unreadable,
    }
}

/// Reads the key from the cookie of the page of operators.
fn in_cookie(headers: &HeaderMap) -> Sent {
    let jar = CookieJar::from_headers(headers);
    jar.get(KEY_COOKIE).map_or(Sent::Nothing, |cookie| Sent::Key(cookie.value().to_owned()))
}

/// Reads the key from a path.
fn in_path(path: &str) -> Sent {
    let key = path.strip_prefix(KEY_PREFIX).and_then(|rest| rest.split('/').next());
    key.map_or(Sent::Nothing, |key| Sent::Key(key.to_owned()))
}
