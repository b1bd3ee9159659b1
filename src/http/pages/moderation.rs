//! The page of operators: the queue, keys and quotas, and hiding and restoring rows. Browsers cannot send keys in
//! headers from a form, so signing in puts the key into a cookie that only this page gets.

use askama::Template;
use axum::Form;
use axum::extract::{DefaultBodyLimit, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
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
use crate::app::limits::LIMITS;
use crate::clock::{now_ms, rfc3339};
use crate::http::extract::caller::{KEY_COOKIE, MODERATION};
use crate::http::extract::origin::Origin;
use crate::http::middleware::rates::Peer;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use crate::store::overview::QueueRow;

/// Time for which signing in lasts: eight hours, in seconds.
const SIGNED_IN_SECONDS: u32 = 8 * 3_600;

/// Returns the routes of the page.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/moderation", get(page))
        .route("/moderation/sign-in", post(sign_in))
        .route("/moderation/sign-out", post(sign_out))
        .route("/moderation/actions", post(action))
        .layer(DefaultBodyLimit::max(LIMITS.form_bytes))
}

/// What an operator filled in and why it was refused, to be shown again.
#[derive(Default)]
struct Draft {
    run: String,
    reason: String,
    fault: String,
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
    draft: Draft,
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

/// Query of the page: why signing in was refused.
#[derive(Deserialize)]
struct PageQuery {
    refused: Option<Refused>,
}

/// Why signing in was refused.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Refused {
    Unknown,
    Scope,
}

/// Serves the page to operators, and a form to sign in to everybody else.
async fn page(State(state): State<AppState>, Query(query): Query<PageQuery>, caller: AppResult<Caller>) -> PageResult {
    let why = match query.refused {
        None => "",
        Some(Refused::Unknown) => "This key is unknown, revoked or expired.",
        Some(Refused::Scope) => "This key lacks the scope admin.",
    };
    shown(&state, caller, Draft::default(), why).await
}

/// Shows the page to operators, with what was filled in, and a form to sign in to everybody else.
async fn shown(state: &AppState, caller: AppResult<Caller>, draft: Draft, why: &str) -> PageResult {
    let told = match &caller {
        Ok(caller) => overview(state, caller).await,
        Err(error) => Err(error.clone()),
    };
    match (told, caller) {
        (Ok(told), Ok(caller)) => {
            let suites = state.catalogue().suites().iter().map(|entry| entry.id.clone()).collect();
            let actor = caller.owner().unwrap_or_default().to_owned();
            let status = if draft.fault.is_empty() { StatusCode::OK } else { StatusCode::UNPROCESSABLE_ENTITY };
            Ok(unkept(status, html::page(&ModerationPage { actor, now_ms: now_ms(), told, suites, draft })?))
        }
        (Err(error), _) if matches!(error.kind(), Kind::Unauthorized | Kind::Forbidden) => {
            Ok(unkept(StatusCode::OK, html::page(&SignInPage { why: why.to_owned() })?))
        }
        (Err(error), _) | (_, Err(error)) => Err(error.into()),
    }
}

/// Gives a page a status, and forbids to keep it.
fn unkept(status: StatusCode, mut page: Response) -> Response {
    *page.status_mut() = status;
    page.headers_mut().insert(header::CACHE_CONTROL, header::HeaderValue::from_static("no-store"));
    page
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
    let refused = match found {
        Some(key) if key.allows(Scope::Admin) => {
            let lasts = format!("Max-Age={SIGNED_IN_SECONDS}; Path={MODERATION}; HttpOnly; SameSite=Strict");
            let cookie = Cookie::parse(format!("{KEY_COOKIE}={sent}; {lasts}"));
            let mut cookie = cookie.expect("a live key has no characters that a cookie cannot have");
            cookie.set_secure(origin.is_secure);
            return Ok((jar.add(cookie), Redirect::to(MODERATION)).into_response());
        }
        Some(_) => "scope",
        None => "unknown",
    };
    Ok(Redirect::to(&format!("{MODERATION}?refused={refused}")).into_response())
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
    let path = run.trim().split(['?', '#']).next().unwrap_or_default();
    let id = path.trim_end_matches('/').rsplit('/').next().unwrap_or_default().to_owned();
    match act(&state, &caller, id, action, &reason).await {
        Ok(done) => Ok(Redirect::to(&format!("/runs/{}#moderation-log", done.run)).into_response()),
        Err(error) if matches!(error.kind(), Kind::NotFound | Kind::Conflict(_) | Kind::InvalidBody) => {
            let faults = error.faults().iter().map(|fault| fault.detail.clone()).collect::<Vec<_>>().join("; ");
            let fault = if faults.is_empty() { error.detail().to_owned() } else { format!("reason: {faults}") };
            shown(&state, Ok(caller), Draft { run, reason, fault }, "").await
        }
        Err(error) => Err(error.into()),
    }
}

/// Refuses a form that another site sends. Browsers say where a form comes from, and do not send the cookie from
/// elsewhere.
fn must_be_own(headers: &HeaderMap, origin: &Origin) -> AppResult<()> {
    let told = headers.get(header::ORIGIN).and_then(|value| value.to_str().ok());
    let host = told.map(|told| told.split_once("://").map_or(told, |(_, host)| host));
    let is_own = match headers.get("sec-fetch-site") {
        // What browsers say of the site does not depend on the headers that a proxy changes.
        Some(site) => site == "same-origin" || site == "none",
        None => host.is_none_or(|host| host.eq_ignore_ascii_case(&origin.host)),
    };
    if is_own {
        return Ok(());
    }
    Err(AppError::new(Kind::Forbidden, "this form must be sent from the page of this service"))
}
