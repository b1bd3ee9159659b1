//! The page of operators: the queue, keys and quotas, and hiding and restoring rows. Browsers cannot send keys in headers from
//! a form, so signing in puts the key into a cookie that only this page gets.

use askama::Template;
use axum::Form;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::{get, post};
use axum::{Extension, Router};
use axum_extra::extract::CookieJar;
use axum_extra::extract::cookie::Cookie;
use serde::Deserialize;

use super::html::{self, PageResult};
use crate::app::access::Caller;
use crate::app::accounts::operations::{Overview, overview};
use crate::app::boards::actions::{HideOrRestore, act};
use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::{now_ms, rfc3339};
use crate::http::extract::caller::{KEY_COOKIE, MODERATION};
use crate::http::extract::origin::Origin;
use crate::http::middleware::rates::Peer;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use crate::store::overview::QueueRow;

/// Time for which signing in lasts: eight hours, in seconds.
const SIGNED_IN_SECONDS: u32 = 8 * 3_600;
/// Maximum size of a form, in bytes.
const MAX_FORM_BYTES: usize = 16 << 10;

/// Returns the routes of the page.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/moderation", get(page))
        .route("/moderation/sign-in", post(sign_in))
        .route("/moderation/sign-out", post(sign_out))
        .route("/moderation/actions", post(action))
        .layer(DefaultBodyLimit::max(MAX_FORM_BYTES))
}

#[derive(Template)]
#[template(path = "sign_in.html")]
struct SignInPage {
    /// Why the key that was sent does not do; empty if none was sent.
    why: String,
}

#[derive(Template)]
#[template(path = "moderation.html")]
struct ModerationPage {
    actor: String,
    now_ms: i64,
    told: Overview,
    suites: Vec<String>,
}

impl ModerationPage {
    fn ago(&self, at_ms: i64) -> String {
        let seconds = (self.now_ms - at_ms).max(0) / 1_000;
        let coarse = match seconds {
            0..60 => seconds,
            60..3_600 => seconds / 60 * 60,
            3_600..86_400 => seconds / 3_600 * 3_600,
            _ => seconds / 86_400 * 86_400,
        };
        html::duration(coarse)
    }

    fn lease_left(&self, row: &QueueRow) -> String {
        html::duration((row.lease_until_ms - self.now_ms).max(0) / 1_000)
    }

    #[expect(clippy::unused_self, reason = "the template calls it")]
    fn day(&self, ms: i64) -> String {
        rfc3339(ms)[..10].to_owned()
    }
}

/// Serves the page to operators, and a form to sign in to everybody else.
async fn page(State(state): State<AppState>, caller: AppResult<Caller>) -> PageResult {
    let told = match &caller {
        Ok(caller) => overview(&state, caller).await,
        Err(error) => Err(error.clone()),
    };
    match (told, caller) {
        (Ok(told), Ok(caller)) => {
            let suites = state.catalogue().suites().iter().map(|entry| entry.suite.id()).collect();
            let actor = caller.owner().unwrap_or_default().to_owned();
            let mut response = html::page(&ModerationPage { actor, now_ms: now_ms(), told, suites })?;
            response.headers_mut().insert(header::CACHE_CONTROL, header::HeaderValue::from_static("no-store"));
            Ok(response)
        }
        (Err(error), caller) if matches!(error.kind(), Kind::Unauthorized | Kind::Forbidden) => {
            let was_sent = caller.is_ok_and(|caller| caller.key.is_some());
            let why = if was_sent { error.detail().to_owned() } else { String::new() };
            html::page(&SignInPage { why })
        }
        (Err(error), _) | (_, Err(error)) => Err(error.into()),
    }
}

/// Form to sign in.
#[derive(Deserialize)]
struct SignIn {
    key: String,
}

/// Puts the key of an operator into the cookie of the page.
async fn sign_in(
    State(state): State<AppState>,
    peer: Option<Extension<Peer>>,
    origin: Origin,
    headers: HeaderMap,
    jar: CookieJar,
    Form(SignIn { key }): Form<SignIn>,
) -> Result<Response, Response> {
    must_be_own(&headers, &origin).map_err(AppError::into_response)?;
    let sent = key.trim();
    // Looking up an unknown key reads the database, so these lookups have a rate limit of their own.
    if !state.keys.knows(sent) {
        let peer = peer.map(|Extension(peer)| peer);
        state.rates.looking_up(peer, &headers).map_err(IntoResponse::into_response)?;
    }
    let found = state.live_key(sent).await.map_err(AppError::into_response)?;
    let why = match found {
        Some(key) if key.allows(Scope::Admin) => {
            let lasts = format!("Max-Age={SIGNED_IN_SECONDS}; Path={MODERATION}; HttpOnly; SameSite=Strict");
            let cookie = Cookie::parse(format!("{KEY_COOKIE}={sent}; {lasts}"));
            let mut cookie = cookie.expect("a live key has no characters that a cookie cannot have");
            cookie.set_secure(origin.is_secure);
            return Ok((jar.add(cookie), Redirect::to(MODERATION)).into_response());
        }
        Some(_) => "This key lacks the scope admin.",
        None => "This key is unknown, revoked or expired.",
    };
    html::page(&SignInPage { why: why.to_owned() }).map_err(IntoResponse::into_response)
}

/// Removes the cookie.
async fn sign_out(jar: CookieJar, origin: Origin, headers: HeaderMap) -> PageResult {
    must_be_own(&headers, &origin)?;
    let mut cookie = Cookie::from(KEY_COOKIE);
    cookie.set_path(MODERATION);
    Ok((jar.remove(cookie), Redirect::to(MODERATION)).into_response())
}

/// Form to hide or restore a row.
#[derive(Deserialize)]
struct NewAction {
    run: String,
    action: HideOrRestore,
    reason: String,
}

/// Hides or restores a row, and shows its run, which tells what was done.
async fn action(
    State(state): State<AppState>,
    caller: Caller,
    origin: Origin,
    headers: HeaderMap,
    Form(NewAction { run, action, reason }): Form<NewAction>,
) -> PageResult {
    must_be_own(&headers, &origin)?;
    // A run may be given by the address of its page.
    let run = run.trim().trim_end_matches('/').rsplit('/').next().unwrap_or_default().to_owned();
    let done = act(&state, &caller, run, action, &reason).await?;
    Ok(Redirect::to(&format!("/runs/{}#moderation-log", done.run)).into_response())
}

/// Refuses a form that another site sends. Browsers say where a form comes from, and the cookie is not sent from elsewhere.
fn must_be_own(headers: &HeaderMap, origin: &Origin) -> AppResult<()> {
    let told = headers.get(header::ORIGIN).and_then(|value| value.to_str().ok());
    let host = told.map(|told| told.split_once("://").map_or(told, |(_, host)| host));
    if host.is_none_or(|host| host.eq_ignore_ascii_case(&origin.host)) {
        return Ok(());
    }
    Err(AppError::new(Kind::Forbidden, "this form must be sent from the page of this service"))
}
