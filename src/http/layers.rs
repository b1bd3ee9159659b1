//! Layers around every route: request ids, access log, metrics, time limit, panics, compression, and problems for
//! errors that no handler made.

use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse as _, Response};
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::cors::{Any, CorsLayer};
use tower_http::decompression::RequestDecompressionLayer;
use tower_http::request_id::{MakeRequestUuid, PropagateRequestIdLayer, SetRequestIdLayer};
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::timeout::TimeoutLayer;

use super::limits::LIMITS;
use super::problem::{ApiError, PROBLEM_JSON};

/// Header of the request id: taken from the client or made here, and always sent back.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest text of an error made by a library that is passed on.
const MAX_DETAIL_BYTES: usize = 2_048;

/// Puts the layers around `router`. The first named is the outermost.
pub fn around(router: Router) -> Router {
    let request_timeout = Duration::from_secs(LIMITS.request_seconds);
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(REQUEST_ID, MakeRequestUuid))
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(from_fn(observe))
        .layer(SetResponseHeaderLayer::if_not_present(
            header::X_CONTENT_TYPE_OPTIONS,
            HeaderValue::from_static("nosniff"),
        ))
        .layer(CorsLayer::new().allow_origin(Any).allow_methods(Any).allow_headers(Any).expose_headers(Any))
        .layer(CompressionLayer::new())
        .layer(from_fn(as_problem))
        .layer(CatchPanicLayer::custom(on_panic))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, request_timeout))
        .layer(RequestDecompressionLayer::new());
    router.layer(layers)
}

#[expect(clippy::needless_pass_by_value, reason = "the layer hands the payload over")]
fn on_panic(payload: Box<dyn std::any::Any + Send + 'static>) -> Response {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
    ApiError::internal(&format!("panic: {text}")).into_response()
}

/// Counts and logs each request once, by route and not by path.
async fn observe(request: Request, next: Next) -> Response {
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("unmatched", |path| path.as_str()).to_owned();
    let id = request.headers().get(REQUEST_ID).and_then(|id| id.to_str().ok()).unwrap_or_default().to_owned();
    let begun = Instant::now();
    let response = next.run(request).await;
    let (status, took) = (response.status().as_u16(), begun.elapsed());
    let labels =
        [("method", known_method(&method).to_owned()), ("route", route.clone()), ("status", status.to_string())];
    metrics::counter!("plumbline_http_requests_total", &labels).increment(1);
    metrics::histogram!("plumbline_http_request_seconds", "route" => route.clone()).record(took.as_secs_f64());
    tracing::debug!(%method, route, status, took_us = took.as_micros() as u64, request_id = id, "request");
    response
}

/// The method, or `other`: a client may invent any number of them, and each would be a series of its own.
fn known_method(method: &Method) -> &str {
    let known = [Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::PATCH, Method::DELETE, Method::OPTIONS];
    if known.contains(method) { method.as_str() } else { "other" }
}

/// Makes problems of errors that come from libraries as plain text or without a body.
async fn as_problem(request: Request, next: Next) -> Response {
    let asked = format!("{} {}", request.method(), request.uri().path());
    let response = next.run(request).await;
    let status = response.status();
    let is_error = status.is_client_error() || status.is_server_error();
    let has_problem = response.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == PROBLEM_JSON);
    if !is_error || has_problem {
        return response;
    }
    let (parts, body) = response.into_parts();
    let problem = match status {
        StatusCode::NOT_FOUND => ApiError::not_found(format!("there is nothing at {asked}")),
        StatusCode::METHOD_NOT_ALLOWED => {
            let detail = format!("{asked} is not possible; the Allow header names what is");
            ApiError::new(status, "method-not-allowed", "Method not allowed", detail)
        }
        StatusCode::REQUEST_TIMEOUT => {
            let detail = format!("the request took longer than {} s", LIMITS.request_seconds);
            ApiError::new(status, "timeout", "Timeout", detail)
        }
        StatusCode::UNSUPPORTED_MEDIA_TYPE => {
            let detail = "this Content-Encoding is not supported; send gzip, zstd or none";
            ApiError::new(status, "unsupported-media-type", "Unsupported media type", detail)
        }
        _ if status.is_server_error() => ApiError::internal(&format!("{asked}: {status}")),
        _ => ApiError::new(status, "bad-request", "Bad request", text_of(body).await),
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
