//! Gives each request an identifier, metrics by route (not by path) and a log line, and allows pages of any origin to
//! read the response (CORS).

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use metrics::{Counter, Histogram};
use uuid::Uuid;

use crate::http::extract::caller::MODERATION;

/// Header of the request identifier, which the client or this module sets; every response has it.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Maximum length of an identifier from a client, in bytes.
const MAX_ID_BYTES: usize = 128;
/// Route label of requests that match no route.
const UNMATCHED: &str = "unmatched";

/// Assigns an identifier to the request, answers preflight requests, and records metrics and a log line.
pub async fn observe(mut request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().cloned();
    let is_for_operators = request.uri().path().starts_with(MODERATION);
    let id = id_of(request.headers_mut());
    let mut response = if is_preflight(&request) { allowed() } else { next.run(request).await };
    let route = route.as_ref().map_or(UNMATCHED, MatchedPath::as_str);
    let (status, took) = (response.status().as_u16(), begun.elapsed());
    let series = Series::of(route);
    series.seconds.record(took.as_secs_f64());
    series.count(&method, status, route).increment(1);
    let owner = response.extensions_mut().remove::<Owner>();
    log(&method, route, status, took, &id, owner.as_ref());
    let headers = response.headers_mut();
    headers.insert(REQUEST_ID, id);
    headers.entry(header::X_CONTENT_TYPE_OPTIONS).or_insert(HeaderValue::from_static("nosniff"));
    if is_for_operators {
        return response;
    }
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static("*"));
    response
}

/// Owner of the key that a request was sent with, for its log line.
#[derive(Debug, Clone)]
pub(super) struct Owner(pub String);

/// Logs a request without its path, key and body; probes and assets, which are requested often, at level debug.
fn log(method: &Method, route: &str, status: u16, took: Duration, id: &HeaderValue, owner: Option<&Owner>) {
    const QUIET: [&str; 4] = ["/healthz", "/readyz", "/metrics", "/assets/{name}"];
    let owner = owner.map(|owner| owner.0.as_str());
    let (id, ms) = (id.to_str().unwrap_or_default(), took.as_secs_f64() * 1e3);
    if QUIET.contains(&route) {
        tracing::debug!(target: "plumbline::request", request_id = id, %method, route, status, duration_ms = ms, owner, "request");
    } else {
        tracing::info!(target: "plumbline::request", request_id = id, %method, route, status, duration_ms = ms, owner, "request");
    }
}

/// Returns whether a request is a CORS preflight.
fn is_preflight(request: &Request) -> bool {
    request.method() == Method::OPTIONS
        && !request.uri().path().starts_with(MODERATION)
        && request.headers().contains_key(header::ACCESS_CONTROL_REQUEST_METHOD)
}

/// Answers a preflight: allows all requests. That is safe because access depends on a key in a header, which browsers
/// never add by themselves. The page of operators, which has a cookie, is left out.
fn allowed() -> Response {
    let allow = [
        (header::ACCESS_CONTROL_ALLOW_METHODS, "*"),
        // The wildcard does not cover `authorization` (Fetch standard, "CORS non-wildcard request-header name").
        (header::ACCESS_CONTROL_ALLOW_HEADERS, "*, authorization"),
        (header::ACCESS_CONTROL_MAX_AGE, "86400"),
    ];
    (StatusCode::NO_CONTENT, allow).into_response()
}

/// Returns the client's identifier if it is valid, otherwise a new one, which is unique in this process and almost
/// certainly across processes.
fn id_of(headers: &mut HeaderMap) -> HeaderValue {
    static PROCESS: LazyLock<String> = LazyLock::new(|| Uuid::new_v4().simple().to_string());
    static NEXT: AtomicU64 = AtomicU64::new(0);
    if let Some(id) = headers.get(REQUEST_ID).filter(|id| !id.is_empty() && id.len() <= MAX_ID_BYTES) {
        return id.clone();
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let id = HeaderValue::try_from(format!("{}-{number:x}", &PROCESS[..16]));
    id.unwrap_or(HeaderValue::from_static("none"))
}

/// Metrics of a route, cached because looking them up by label takes longer than answering many a request.
struct Series {
    seconds: Histogram,
    counts: RwLock<Vec<(Method, u16, Counter)>>,
}

impl Series {
    fn of(route: &str) -> Arc<Self> {
        static ALL: LazyLock<RwLock<HashMap<String, Arc<Series>>>> = LazyLock::new(RwLock::default);
        if let Some(series) = ALL.read().unwrap_or_else(PoisonError::into_inner).get(route) {
            return Arc::clone(series);
        }
        let seconds = metrics::histogram!("plumbline_http_request_seconds", "route" => route.to_owned());
        let series = Arc::new(Self { seconds, counts: RwLock::default() });
        let mut all = ALL.write().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(all.entry(route.to_owned()).or_insert(series))
    }

    fn count(&self, method: &Method, status: u16, route: &str) -> Counter {
        let is_it = |(of, with, _): &&(Method, u16, Counter)| of == known(method) && *with == status;
        if let Some((_, _, counter)) = self.counts.read().unwrap_or_else(PoisonError::into_inner).iter().find(is_it) {
            return counter.clone();
        }
        let name = if known(method) == method { method.as_str() } else { "other" };
        let labels = [("method", name.to_owned()), ("route", route.to_owned()), ("status", status.to_string())];
        let counter = metrics::counter!("plumbline_http_requests_total", &labels);
        let kept = (known(method).clone(), status, counter.clone());
        self.counts.write().unwrap_or_else(PoisonError::into_inner).push(kept);
        counter
    }
}

/// Returns the method, or `TRACE` for an unusual one. Clients may invent any number of methods, and each would create a
/// series.
fn known(method: &Method) -> &Method {
    const KNOWN: [Method; 7] =
        [Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::PATCH, Method::DELETE, Method::OPTIONS];
    if KNOWN.contains(method) { method } else { &Method::TRACE }
}
