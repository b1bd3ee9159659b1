//! Errors as pages, for browsers that ask for a page.

use askama::Template;
use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use super::problem::{PROBLEM_JSON, Problem};
use plumbline_engine::text::sentence;

/// Content security policy: pages load only files of this service.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'self'; frame-ancestors 'none'";
/// Maximum size of a problem that becomes a page, in bytes.
const MAX_PROBLEM_BYTES: usize = 1 << 20;
/// Media type of what a form on a page sends.
const FORM: &str = "application/x-www-form-urlencoded";
/// Beginning of the paths of the API, whose errors are always problems.
const API: &str = "/v1/";

#[derive(Template)]
#[template(path = "error.html")]
struct ErrorPage<'a> {
    status: u16,
    title: &'a str,
    detail: String,
    /// Whether the query string is at fault, so that the page without it can be shown.
    is_query: bool,
}

/// Returns the headers of all pages.
#[must_use]
pub fn page_headers() -> [(HeaderName, HeaderValue); 3] {
    [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        (header::REFERRER_POLICY, HeaderValue::from_static("same-origin")),
    ]
}

/// Returns whether a request asks for a page, as browsers do.
#[must_use]
pub fn is_asked_for(request: &Request) -> bool {
    let accepts = request.headers().get_all(header::ACCEPT).iter().filter_map(|accepted| accepted.to_str().ok());
    let is_html = |kind: &str| kind.trim().split(';').next() == Some("text/html");
    let is_form = request.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == FORM);
    (matches!(*request.method(), Method::GET | Method::HEAD) || is_form)
        && !request.uri().path().starts_with(API)
        && accepts.flat_map(|accepted| accepted.split(',')).any(is_html)
}

/// Shows a problem as a page; returns `None` if it cannot be rendered.
#[must_use]
pub fn page_of(problem: &Problem) -> Option<Response> {
    // Where a setting is missing, leaving all of them out does not help.
    let is_of_settings = problem.kind.ends_with(":invalid-query");
    let is_query = is_of_settings && !problem.detail.contains("missing field");
    let title = if is_query { "This address has settings that cannot be used" } else { &problem.title };
    let mut detail = in_words_of_readers(&problem.detail, is_of_settings);
    if !detail.ends_with(['.', '?', '!']) {
        detail.push('.');
    }
    let page = ErrorPage { status: problem.status, title, detail, is_query };
    let status = StatusCode::from_u16(problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    Some((status, page_headers(), page.render().ok()?).into_response())
}

/// Writes a detail, which speaks to programs, for people.
fn in_words_of_readers(detail: &str, is_of_settings: bool) -> String {
    if let Some((asked, _)) = detail.strip_prefix("no resource matches ").and_then(|rest| rest.split_once("; ")) {
        let path = asked.split_once(' ').map_or(asked, |(_, path)| path);
        return format!("This service has no page at {path}");
    }
    if let Some((name, _)) = detail.split_once(": missing field").filter(|_| is_of_settings) {
        return format!("The address lacks the setting {name:?}");
    }
    // A detail about settings begins with the name of one.
    if is_of_settings { detail.to_owned() } else { sentence(detail) }
}

/// Shows a response as a page if it is a problem; its other headers stay.
pub async fn as_page(response: Response) -> Response {
    if response.headers().get(header::CONTENT_TYPE).is_none_or(|kind| kind != PROBLEM_JSON) {
        return response;
    }
    let (mut parts, body) = response.into_parts();
    let bytes = to_bytes(body, MAX_PROBLEM_BYTES).await.unwrap_or_default();
    // The answer to HEAD has no body.
    let page = serde_json::from_slice(&bytes).ok().and_then(|problem| page_of(&problem));
    let Some(page) = page else { return Response::from_parts(parts, Body::from(bytes)) };
    let (page, body) = page.into_parts();
    parts.headers.remove(header::CONTENT_LENGTH);
    parts.headers.extend(page.headers);
    Response::from_parts(parts, body)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(method: &str, path: &str, accept: &str) -> bool {
        let request = Request::builder().method(method).uri(path).header(header::ACCEPT, accept);
        is_asked_for(&request.body(Body::empty()).unwrap())
    }

    #[test]
    fn browsers_ask_for_pages_and_others_do_not() {
        let browser = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8";
        assert!(asked("GET", "/nosuch", browser));
        assert!(!asked("GET", "/v1/nosuch", browser));
        assert!(!asked("POST", "/nosuch", browser));
        assert!(!asked("GET", "/nosuch", "*/*"));
        assert!(!asked("GET", "/nosuch", "application/json"));
    }

    #[tokio::test]
    async fn a_problem_becomes_a_page_and_keeps_its_headers() {
        let error = crate::app::error::AppError::not_found("no resource matches GET /<b>").retry_after(7);
        let page = as_page(error.into_response()).await;
        let (status, headers) = (page.status(), page.headers().clone());
        let text = String::from_utf8(to_bytes(page.into_body(), usize::MAX).await.unwrap().to_vec()).unwrap();
        assert_eq!((status, &headers[header::RETRY_AFTER]), (StatusCode::NOT_FOUND, &HeaderValue::from_static("7")));
        assert_eq!(headers.get_all(header::CONTENT_TYPE).iter().count(), 1);
        assert!(headers[header::CONTENT_TYPE].to_str().unwrap().starts_with("text/html"), "{headers:?}");
        assert!(text.contains("<h1>Not found</h1>") && !text.contains("<b>"), "{text}");
        for (detail, is_of_settings, wanted) in [
            (
                "no resource matches GET /x; the API reference lists all operations",
                false,
                "This service has no page at /x",
            ),
            ("b: missing field `b`", true, "The address lacks the setting \"b\""),
            ("page: at least 1", true, "page: at least 1"),
            ("the run does not exist", false, "The run does not exist"),
        ] {
            assert_eq!(in_words_of_readers(detail, is_of_settings), wanted);
        }
    }
}
