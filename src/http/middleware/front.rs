//! What surrounds the router: metrics and logs, callers and rate limits, the time limit, panics, compression, and
//! problem documents for errors that no handler produced.
//!
//! These are functions around the router as a whole. As layers of the router, they box the future and the body of every
//! request several times, which together takes longer than answering most reads. Only `CheckedRoute` is a layer,
//! because it needs the route.

use std::convert::Infallible;
use std::panic::AssertUnwindSafe;
use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, Uri, Version, header};
use axum::response::{IntoResponse as _, Response};
use futures_util::FutureExt as _;
use tower::{Layer as _, ServiceExt as _, service_fn};
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;
use tower_http::decompression::RequestDecompressionLayer;

use super::near;
use super::observe::{Observation, Owner, allowed, is_preflight};
use super::route::{CheckedRoute, OnlyRoute, RouteSlot};
use super::unrewarded;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::http::error_page;
use crate::http::extract::caller::{MODERATION, Sender, identify, without_key};
use crate::http::problem::{PROBLEM_JSON, Problem};
use crate::http::role::Role;
use crate::http::state::AppState;

/// Header with a warning about something for which a request was not refused.
const WARNING: HeaderName = HeaderName::from_static("x-plumbline-warning");
/// Maximum length of an error text from a library that is passed on, in bytes.
const MAX_DETAIL_BYTES: usize = 2_048;
/// How long a handler may take.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(LIMITS.request_seconds);

/// The whole service, as a listener sees it.
#[derive(Debug, Clone)]
pub struct Front {
    router: Router,
    state: AppState,
    role: Role,
    /// Whether metrics and the actions of operators are served elsewhere only.
    hides_administration: bool,
}

impl Front {
    /// Builds the service of a node of this role from its routes.
    #[must_use]
    pub fn new(routes: Router, state: AppState, role: Role) -> Self {
        let checking = tower::layer::layer_fn({
            let state = state.clone();
            move |route| CheckedRoute::new(route, state.clone())
        });
        Self { router: routes.layer(checking), state, role, hides_administration: false }
    }

    /// Returns the same service without metrics and the actions of operators.
    #[must_use]
    pub fn without_administration(&self) -> Self {
        Self { hides_administration: true, ..self.clone() }
    }

    /// Answers a request. Errors and panics become responses too.
    pub async fn answer(self, mut request: Request) -> Response {
        let observation = Observation::begin(&mut request);
        let (method, uri) = (request.method().clone(), request.uri().clone());
        let mut response = if is_preflight(&request) { allowed() } else { self.compressed(request).await };
        if let Some(slot) = observation.empty_slot() {
            self.note_route(method, uri, slot.clone()).await;
        }
        observation.finish(&mut response);
        response
    }

    /// Compresses the response if the client takes it.
    async fn compressed(&self, request: Request) -> Response {
        let respond = service_fn(|request| async { Ok::<_, Infallible>(self.respond(request).await) });
        // Compression runs on a thread that also serves other requests, so it must be fast.
        let compression = CompressionLayer::new().quality(CompressionLevel::Fastest);
        let Ok(response) = compression.layer(respond).oneshot(request).await;
        response.map(Body::new)
    }

    /// Notes the route of a request that was answered before it reached the router.
    async fn note_route(&self, method: Method, uri: Uri, slot: RouteSlot) {
        let mut head = Request::new(Body::empty());
        (*head.method_mut(), *head.uri_mut()) = (method, uri);
        head.extensions_mut().insert(slot);
        head.extensions_mut().insert(OnlyRoute);
        let Ok(_) = self.router.clone().oneshot(head).await;
    }

    /// Answers errors in the form that the request asks for: a page for browsers, and otherwise a problem document.
    async fn respond(&self, request: Request) -> Response {
        let wants_page = error_page::is_asked_for(&request);
        let is_for_reward = unrewarded::is_reward_request(request.uri().path());
        let response = self.admit(request).await;
        let response = if is_for_reward { unrewarded::with_null_reward(response).await } else { response };
        if wants_page { error_page::as_page(response).await } else { response }
    }

    /// Refuses a request that is malformed, sent too often or served elsewhere. Tells the sender about its rate limit
    /// and its key.
    async fn admit(&self, mut request: Request) -> Response {
        if let Err(refused) = must_name_host(&request).and_then(|()| must_be_text(&request)) {
            return refused.into_response();
        }
        let Sender { left, owner, refused } = match identify(&self.state, &mut request).await {
            Ok(sender) => sender,
            Err(refused) => return refused.into_response(),
        };
        let mut response = match self.must_serve(&request) {
            Ok(()) => self.run(request).await,
            Err(elsewhere) => elsewhere.into_response(),
        };
        if let Some(left) = left {
            left.write_to(response.headers_mut());
        }
        // A response that refuses the key says so itself.
        if let Some(why) = refused.filter(|_| response.status() != StatusCode::UNAUTHORIZED) {
            let told = HeaderValue::try_from(format!("{why}; the request was treated as one without a key"));
            response.headers_mut().extend(told.ok().map(|told| (WARNING, told)));
        }
        if let Some(owner) = owner {
            response.extensions_mut().insert(Owner(owner));
        }
        response
    }

    /// Refuses what this listener does not serve.
    fn must_serve(&self, request: &Request) -> AppResult<()> {
        if self.hides_administration && is_administration(request) {
            return Err(AppError::not_found("this is served on the administration listener only"));
        }
        self.role.must_serve(request.uri().path())
    }

    /// Lets the router answer, within the time limit. Turns panics, and errors that libraries return without a problem
    /// document, into problem documents.
    async fn run(&self, request: Request) -> Response {
        let (method, uri) = (request.method().clone(), request.uri().clone());
        let answered = AssertUnwindSafe(self.route(request)).catch_unwind();
        let response = match tokio::time::timeout(REQUEST_TIMEOUT, answered).await {
            Ok(Ok(response)) => response,
            Ok(Err(panic)) => return on_panic(panic.as_ref()),
            Err(_) => StatusCode::REQUEST_TIMEOUT.into_response(),
        };
        let is_error = response.status().is_client_error() || response.status().is_server_error();
        if is_error { as_problem(response, &method, &without_key(uri.path())).await } else { response }
    }

    /// Calls the router, with the body decompressed if it has a `Content-Encoding`.
    async fn route(&self, mut request: Request) -> Response {
        // The router would empty the body of its response to HEAD, before it is compressed or becomes a page. The server
        // leaves it out at the end, and the headers are those of GET.
        if request.method() == Method::HEAD {
            *request.method_mut() = Method::GET;
        }
        let router = self.router.clone();
        if request.headers().contains_key(header::CONTENT_ENCODING) {
            let Ok(response) = RequestDecompressionLayer::new().layer(router).oneshot(request).await;
            return response.map(Body::new);
        }
        let Ok(response) = router.oneshot(request).await;
        response
    }
}

fn on_panic(payload: &(dyn std::any::Any + Send + 'static)) -> Response {
    let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned());
    let text = text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default();
    AppError::internal(&format!("panic: {text}")).into_response()
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

/// Returns whether a request is for the metrics or for an action of operators.
fn is_administration(request: &Request) -> bool {
    let path = request.uri().path();
    let is_board_action = request.method() == Method::POST && path.ends_with("/board-actions");
    path == "/metrics" || path.starts_with(MODERATION) || is_board_action
}

async fn as_problem(response: Response, method: &Method, path: &str) -> Response {
    let status = response.status();
    let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    // HTML pages describe the error themselves.
    if kind == PROBLEM_JSON || kind.starts_with("text/html") {
        return response;
    }
    let (parts, body) = response.into_parts();
    let error = match status {
        StatusCode::NOT_FOUND => {
            let near = near::suggestion(path);
            AppError::not_found(format!(
                "no resource matches {method} {path}; the API reference lists all operations{near}"
            ))
        }
        StatusCode::METHOD_NOT_ALLOWED => {
            let detail = format!("{method} {path} is not allowed; the Allow header lists the allowed methods");
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
        _ if status.is_server_error() => AppError::internal(&format!("{method} {path}: {status}")),
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
