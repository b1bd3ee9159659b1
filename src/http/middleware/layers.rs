//! Layers around every route: what is noted of a request, who asks and how often, time limit, panics, compression, and
//! problems for errors that no handler made.

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
use crate::http::extract::caller::{identify, without_key};
use crate::http::problem::{PROBLEM_JSON, Problem};
use crate::http::state::AppState;

/// Header that says what was amiss although the request was served.
const WARNING: HeaderName = HeaderName::from_static("x-plumbline-warning");
/// Longest text of an error made by a library that is passed on.
const MAX_DETAIL_BYTES: usize = 2_048;

/// Puts the layers around `router`. The first named is the outermost.
pub fn around(router: Router, state: AppState) -> Router {
    let request_timeout = Duration::from_secs(LIMITS.request_seconds);
    let layers = ServiceBuilder::new()
        .layer(from_fn(observe))
        // A large answer is compressed on a thread that serves others too.
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

/// Lets a request through where its sender has not sent too many, and makes problems of errors that come from libraries as
/// plain text or without a body.
async fn guard(State(state): State<AppState>, mut request: Request, next: Next) -> Response {
    if let Err(refused) = must_name_host(&request) {
        return refused.into_response();
    }
    let sender = match identify(&state, &mut request).await {
        Ok(sender) => sender,
        Err(refused) => return refused.into_response(),
    };
    let (method, uri) = (request.method().clone(), request.uri().clone());
    let mut response = next.run(request).await;
    let is_error = response.status().is_client_error() || response.status().is_server_error();
    if is_error {
        response = as_problem(response, || format!("{method} {}", without_key(uri.path()))).await;
    }
    if let Some(left) = sender.left {
        left.write_to(response.headers_mut());
    }
    if let Some(why) = sender.refused.filter(|_| response.status().is_success()) {
        let told = HeaderValue::try_from(format!("{why}; the request was served without it"));
        response.headers_mut().extend(told.ok().map(|told| (WARNING, told)));
    }
    if let Some(owner) = sender.owner {
        response.extensions_mut().insert(Owner(owner));
    }
    response
}

/// A request of HTTP/1.1 names one host (RFC 9112, section 3.2): one that names none or two may mean another thing to a proxy in front.
fn must_name_host(request: &Request) -> Result<(), AppError> {
    let hosts = request.headers().get_all(header::HOST).iter().count();
    if hosts == 1 || (hosts == 0 && request.version() < Version::HTTP_11) {
        return Ok(());
    }
    let detail = format!("the request has {hosts} Host headers; HTTP/1.1 asks for one");
    Err(AppError::new(Kind::BadRequest, detail))
}

/// Hides what has a listener of its own: metrics, and what operators do to boards.
pub async fn without_administration(request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let is_board_action = request.method() == Method::POST && path.ends_with("/board-actions");
    if path == "/metrics" || is_board_action {
        return AppError::not_found("this is served on the listener for administration").into_response();
    }
    next.run(request).await
}

async fn as_problem(response: Response, asked: impl Fn() -> String) -> Response {
    let status = response.status();
    let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    // Pages say themselves what is wrong.
    if kind == PROBLEM_JSON || kind.starts_with("text/html") {
        return response;
    }
    let (parts, body) = response.into_parts();
    let problem = match status {
        StatusCode::NOT_FOUND => AppError::not_found(format!("there is nothing at {}", asked())),
        StatusCode::METHOD_NOT_ALLOWED => {
            let detail = format!("{} is not possible; the Allow header names what is", asked());
            AppError::new(Kind::MethodNotAllowed, detail)
        }
        StatusCode::REQUEST_TIMEOUT => {
            let detail = format!("the request took longer than {} s", LIMITS.request_seconds);
            AppError::new(Kind::RequestTimeout, detail)
        }
        StatusCode::UNSUPPORTED_MEDIA_TYPE => {
            let detail = "this Content-Encoding is not supported; send gzip, zstd or none";
            AppError::new(Kind::UnsupportedMediaType, detail)
        }
        _ if status.is_server_error() => AppError::internal(&format!("{}: {status}", asked())),
        _ => {
            let mut problem = Problem::from(AppError::new(Kind::BadRequest, text_of(body).await));
            problem.status = status.as_u16();
            return problem.respond(None);
        }
    };
    let mut response = problem.into_response();
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
