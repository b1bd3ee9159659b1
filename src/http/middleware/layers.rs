//! Layers around every route: metrics and logs, callers and rate limits, the time limit, panics, compression, and
//! problem documents for errors that no handler produced.

use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, Version, header};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use tower::ServiceBuilder;
use tower_http::CompressionLevel;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::decompression::RequestDecompressionLayer;
use tower_http::timeout::TimeoutLayer;

use super::observe::{Owner, observe};
use crate::app::error::{AppError, Kind};
use crate::app::limits::LIMITS;
use crate::http::error_page;
use crate::http::extract::caller::{MODERATION, identify, without_key};
use crate::http::problem::{PROBLEM_JSON, Problem};
use crate::http::state::AppState;

/// Header with a warning about something for which a request was not refused.
const WARNING: HeaderName = HeaderName::from_static("x-plumbline-warning");
/// Maximum length of an error text from a library that is passed on, in bytes.
const MAX_DETAIL_BYTES: usize = 2_048;

/// Wraps `router` in the layers; the first layer is the outermost.
pub fn around(router: Router, state: AppState) -> Router {
    let request_timeout = Duration::from_secs(LIMITS.request_seconds);
    let layers = ServiceBuilder::new()
        .layer(from_fn(observe))
        // Compression runs on a thread that also serves other requests, so it must be fast.
        .layer(CompressionLayer::new().quality(CompressionLevel::Fastest))
        .layer(from_fn_with_state(state, guard))
        .layer(CatchPanicLayer::custom(on_panic))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, request_timeout))
        .layer(RequestDecompressionLayer::new());
    router.layer(layers)
}

#[expect(clippy::needless_pass_by_value, reason = "the layer hands the payload over")]
fn on_panic(payload: Box<dyn std::any::Any + Send + 'static>) -> Response {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
    AppError::internal(&format!("panic: {text}")).into_response()
}

/// Answers errors in the form that the request asks for: a page for browsers, and otherwise a problem document.
async fn guard(State(state): State<AppState>, request: Request, next: Next) -> Response {
    let wants_page = error_page::is_asked_for(&request);
    let response = checked(&state, request, next).await;
    if wants_page { error_page::as_page(response).await } else { response }
}

/// Rejects a request whose sender exceeds the rate limit, and turns errors that libraries return as plain text or
/// without a body into problem documents.
async fn checked(state: &AppState, mut request: Request, next: Next) -> Response {
    if let Err(refused) = must_name_host(&request).and_then(|()| must_be_text(&request)) {
        return refused.into_response();
    }
    let sender = match identify(state, &mut request).await {
        Ok(sender) => sender,
        Err(refused) => return refused.into_response(),
    };
    let (method, uri) = (request.method().clone(), request.uri().clone());
    let mut response = match state.parameterless.check(&request) {
        Ok(()) => next.run(request).await,
        Err(refused) => refused.into_response(),
    };
    let is_error = response.status().is_client_error() || response.status().is_server_error();
    if is_error {
        response = as_problem(response, || format!("{method} {}", without_key(uri.path()))).await;
    }
    if let Some(left) = sender.left {
        left.write_to(response.headers_mut());
    }
    // A response that refuses the key says so itself.
    if let Some(why) = sender.refused.filter(|_| response.status() != StatusCode::UNAUTHORIZED) {
        let told = HeaderValue::try_from(format!("{why}; the request was treated as one without a key"));
        response.headers_mut().extend(told.ok().map(|told| (WARNING, told)));
    }
    if let Some(owner) = sender.owner {
        response.extensions_mut().insert(Owner(owner));
    }
    response
}

/// Rejects an HTTP/1.1 request without exactly one Host header (RFC 9112, section 3.2), because a proxy in front may
/// interpret it differently.
fn must_name_host(request: &Request) -> Result<(), AppError> {
    let hosts = request.headers().get_all(header::HOST).iter().count();
    if hosts == 1 || (hosts == 0 && request.version() < Version::HTTP_11) {
        return Ok(());
    }
    let detail = format!("the request has {hosts} Host headers; HTTP/1.1 requires exactly one");
    Err(AppError::new(Kind::BadRequest, detail))
}

/// Rejects a path or query with a NUL character, which no name contains and which PostgreSQL cannot compare.
fn must_be_text(request: &Request) -> Result<(), AppError> {
    let whole = request.uri().path_and_query().map_or("", axum::http::uri::PathAndQuery::as_str);
    if whole.contains("%00") {
        return Err(AppError::new(Kind::BadRequest, "the path or the query contains a NUL character (%00)"));
    }
    Ok(())
}

/// Hides the routes that are served on the administration listener only: metrics and board actions.
pub async fn without_administration(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let is_board_action = request.method() == Method::POST && path.ends_with("/board-actions");
    if path == "/metrics" || path.starts_with(MODERATION) || is_board_action {
        return AppError::not_found("this is served on the administration listener only").into_response();
    }
    next.run(request).await
}

async fn as_problem(response: Response, asked: impl Fn() -> String) -> Response {
    let status = response.status();
    let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    // HTML pages describe the error themselves.
    if kind == PROBLEM_JSON || kind.starts_with("text/html") {
        return response;
    }
    let (parts, body) = response.into_parts();
    let error = match status {
        StatusCode::NOT_FOUND => {
            AppError::not_found(format!("no resource matches {}; the API reference lists all operations", asked()))
        }
        StatusCode::METHOD_NOT_ALLOWED => {
            let detail = format!("{} is not allowed; the Allow header lists the allowed methods", asked());
            AppError::new(Kind::MethodNotAllowed, detail)
        }
        StatusCode::REQUEST_TIMEOUT => {
            let detail = format!("the request took longer than {} s", LIMITS.request_seconds);
            // What held it up, such as a dead connection to the database, may be over.
            AppError::new(Kind::RequestTimeout, detail).retry_after(1)
        }
        StatusCode::UNSUPPORTED_MEDIA_TYPE => {
            let detail = "this Content-Encoding is not supported; send gzip, zstd or none";
            AppError::new(Kind::UnsupportedMediaType, detail)
        }
        _ if status.is_server_error() => AppError::internal(&format!("{}: {status}", asked())),
        _ => AppError::new(Kind::BadRequest, text_of(body).await),
    };
    let retry_after_s = error.retry_after_s();
    // The status of whatever refused the request stays, also where no kind of ours has it.
    let problem = Problem { status: status.as_u16(), ..Problem::from(error) };
    let mut response = problem.respond(retry_after_s);
    for name in [header::ALLOW, header::RETRY_AFTER, header::ACCEPT_ENCODING] {
        if let Some(value) = parts.headers.get(&name) {
            response.headers_mut().insert(name, value.clone());
        }
    }
    response
}

async fn text_of(body: Body) -> String {
    let bytes = to_bytes(body, MAX_DETAIL_BYTES).await.unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}
