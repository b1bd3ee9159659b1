//! The origin under which a client reaches the service, for links that must name it.

use std::convert::Infallible;
use std::fmt;

use axum::extract::FromRequestParts;
use axum::http::header::{self, AsHeaderName};
use axum::http::request::Parts;

use crate::http::state::AppState;

/// Host of a client that names none.
const DEFAULT_HOST: &str = "localhost:7586";

/// Scheme and host of a request's URL. Behind a proxy, `X-Forwarded-Proto` and `X-Forwarded-Host` tell what the client
/// asked for; if it names the client alone (`X-Forwarded-For`), that is taken for https, so that no cookie goes out without
/// its protection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// Whether the client uses https.
    pub is_secure: bool,
    /// Host, with a port unless it is the scheme's own.
    pub host: String,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", if self.is_secure { "https" } else { "http" }, self.host)
    }
}

impl Origin {
    fn of(request: &Parts, is_behind_proxy: bool) -> Self {
        let forwarded = |name: &str| last(request, name).filter(|_| is_behind_proxy);
        // An operator may reach the admin listener without the proxy.
        let has_passed_proxy = forwarded("x-forwarded-for").is_some();
        let named = forwarded("x-forwarded-host").or_else(|| last(request, header::HOST));
        let host = named.or_else(|| request.uri.authority().map(ToString::to_string)).filter(|host| is_host(host));
        Self {
            is_secure: forwarded("x-forwarded-proto")
                .map_or(has_passed_proxy, |scheme| scheme.eq_ignore_ascii_case("https")),
            host: host.unwrap_or_else(|| DEFAULT_HOST.to_owned()),
        }
    }
}

impl FromRequestParts<AppState> for Origin {
    type Rejection = Infallible;

    async fn from_request_parts(request: &mut Parts, state: &AppState) -> Result<Self, Self::Rejection> {
        Ok(Self::of(request, state.rates.is_behind_proxy()))
    }
}

/// Returns the last entry of a header: the one that the nearest proxy wrote.
fn last(request: &Parts, name: impl AsHeaderName) -> Option<String> {
    let value = request.headers.get_all(name).iter().next_back()?.to_str().ok()?;
    value.rsplit(',').next().map(|entry| entry.trim().to_owned())
}

/// Returns whether a text can be a host with a port: nothing in it could end a link.
fn is_host(text: &str) -> bool {
    let is_part = |c: char| c.is_ascii_alphanumeric() || ".-_:[]%".contains(c);
    !text.is_empty() && text.chars().all(is_part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::Request;

    fn origin(headers: &[(&str, &str)], is_behind_proxy: bool) -> String {
        let mut request = Request::builder().uri("/");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        Origin::of(&request.body(()).unwrap().into_parts().0, is_behind_proxy).to_string()
    }

    #[test]
    fn only_a_proxy_is_believed_about_scheme_and_host() {
        let forwarded =
            [("host", "node:80"), ("x-forwarded-proto", "http, https"), ("x-forwarded-host", "bench.example")];
        assert_eq!(origin(&forwarded, true), "https://bench.example");
        assert_eq!(origin(&forwarded, false), "http://node:80");
        let passed = ("x-forwarded-for", "192.0.2.1");
        assert_eq!(origin(&[("host", "[::1]:7586"), passed], true), "https://[::1]:7586");
        assert_eq!(origin(&[("host", "[::1]:7586"), passed], false), "http://[::1]:7586");
        assert_eq!(origin(&[("host", "[::1]:7586")], true), "http://[::1]:7586");
        assert_eq!(origin(&[("host", "[::1]:7586"), ("x-forwarded-proto", "http")], true), "http://[::1]:7586");
        assert_eq!(origin(&[("host", "a\"><b>")], false), "http://localhost:7586");
        assert_eq!(origin(&[], false), "http://localhost:7586");
    }
}
