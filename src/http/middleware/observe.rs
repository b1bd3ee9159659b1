//! Gives each request an identifier, metrics by route (not by path) and a log line, and allows pages of any origin to
//! read the response (CORS).

use std::collections::HashMap;
use std::hash::{BuildHasher as _, RandomState};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};
use std::time::{Duration, Instant};

use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use metrics::{Counter, Histogram};
use uuid::Uuid;

use super::route::RouteSlot;
use crate::http::extract::caller::MODERATION;

/// Header of the request identifier, which the client or this module sets; every response has it.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Maximum length of an identifier from a client, in bytes.
const MAX_ID_BYTES: usize = 128;
/// Route label of requests that match no route.
const UNMATCHED: &str = "unmatched";

/// What is noted when a request arrives, for its metrics, its log line and the headers of its response.
#[derive(Debug)]
pub(super) struct Observation {
    begun: Instant,
    method: Method,
    id: HeaderValue,
    route: RouteSlot,
    is_for_operators: bool,
}

impl Observation {
    /// Gives a request its identifier, and a slot for its route.
    pub(super) fn begin(request: &mut Request) -> Self {
        let route = RouteSlot::default();
        request.extensions_mut().insert(route.clone());
        Self {
            begun: Instant::now(),
            method: request.method().clone(),
            id: id_of(request.headers()),
            route,
            is_for_operators: request.uri().path().starts_with(MODERATION),
        }
    }

    /// Returns the slot for the route of the request if it is empty.
    pub(super) fn empty_slot(&self) -> Option<&RouteSlot> {
        Some(&self.route).filter(|slot| slot.get().is_none())
    }

    /// Records metrics and a log line for the response, and completes its headers.
    pub(super) fn finish(self, response: &mut Response) {
        let route = self.route.get().map_or(UNMATCHED, MatchedPath::as_str);
        let (status, took) = (response.status().as_u16(), self.begun.elapsed());
        let series = Series::of(route);
        if !is_hidden(route) {
            series.seconds.record(took.as_secs_f64());
        }
        series.count(&self.method, status, route).increment(1);
        let owner = response.extensions_mut().remove::<Owner>();
        log(&self.method, route, status, took, &self.id, owner.as_ref());
        let headers = response.headers_mut();
        headers.insert(REQUEST_ID, self.id);
        headers.entry(header::X_CONTENT_TYPE_OPTIONS).or_insert(HeaderValue::from_static("nosniff"));
        if self.is_for_operators {
            return;
        }
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
        headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static("*"));
    }
}

/// Returns whether a route takes part in hidden evaluation, as episodes may: how long one of its requests took would tell
/// what an entrant's code did.
fn is_hidden(route: &str) -> bool {
    ["/v1/entries/", "/v1/instances/", "/v1/episodes/"].iter().any(|beginning| route.starts_with(beginning))
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
pub(super) fn is_preflight(request: &Request) -> bool {
    request.method() == Method::OPTIONS
        && !request.uri().path().starts_with(MODERATION)
        && request.headers().contains_key(header::ACCESS_CONTROL_REQUEST_METHOD)
}

/// Answers a preflight: allows all requests. That is safe because access depends on a key in a header, which browsers
/// never add by themselves. The page of operators, which has a cookie, is left out.
pub(super) fn allowed() -> Response {
    let allow = [
        (header::ACCESS_CONTROL_ALLOW_METHODS, "*"),
        // The wildcard does not cover `authorization` (Fetch standard, "CORS non-wildcard request-header name").
        (header::ACCESS_CONTROL_ALLOW_HEADERS, "*, authorization"),
        (header::ACCESS_CONTROL_MAX_AGE, "86400"),
    ];
    (StatusCode::NO_CONTENT, allow).into_response()
}

/// Returns the client's identifier if it is valid, otherwise a new one of 32 hexadecimal digits, almost certainly unique:
/// the first half identifies the process, the second the request. It does not tell how many requests came before.
fn id_of(headers: &HeaderMap) -> HeaderValue {
    static PROCESS: LazyLock<u64> = LazyLock::new(|| Uuid::new_v4().as_u64_pair().0);
    static HASHES: LazyLock<RandomState> = LazyLock::new(RandomState::new);
    static NEXT: AtomicU64 = AtomicU64::new(1);
    // The id is logged, where no key may be.
    let holds_key = |id: &HeaderValue| id.as_bytes().windows(4).any(|bytes| bytes == b"plk_");
    let is_fit = |id: &&HeaderValue| !id.is_empty() && id.len() <= MAX_ID_BYTES && !holds_key(id);
    if let Some(id) = headers.get(REQUEST_ID).filter(is_fit) {
        return id.clone();
    }
    let number = HASHES.hash_one(NEXT.fetch_add(1, Ordering::Relaxed));
    let mut digits = Uuid::encode_buffer();
    let digits = Uuid::from_u64_pair(*PROCESS, number).simple().encode_lower(&mut digits);
    HeaderValue::from_str(digits).expect("hexadecimal digits are valid in a header value")
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
