//! Reading webhooks that requests describe.

use super::addresses::is_public;
use super::message::WebhookEvent;
use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use reqwest::Url;
use std::net::IpAddr;

/// Webhook as a request describes it.
#[derive(Debug, Clone)]
pub struct WebhookDraft {
    /// Address to which events are posted.
    pub url: String,
    /// Events to post; all if none are named.
    pub events: Option<Vec<WebhookEvent>>,
}

/// Webhook in the form in which it is stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckedWebhook {
    /// Address to which events are posted.
    pub url: String,
    /// Names of the events by commas; empty for all.
    pub events: String,
}

/// Checks a webhook and adds all its faults.
pub fn check(draft: &WebhookDraft, allows_private: bool, faults: &mut Faults) -> Option<CheckedWebhook> {
    let url = match check_url(&draft.url, allows_private) {
        Ok(url) => Some(url),
        Err(fault) => {
            faults.add_at("url", fault);
            None
        }
    };
    if draft.events.as_ref().is_some_and(Vec::is_empty) {
        faults.add_at("events", "expected one event or more; leave it out for all");
        return None;
    }
    let chosen = draft.events.as_deref().unwrap_or_default();
    let names = WebhookEvent::ALL.into_iter().filter(|event| chosen.contains(event)).map(WebhookEvent::name);
    Some(CheckedWebhook { url: url?, events: names.collect::<Vec<_>>().join(",") })
}

/// Checks the address of a webhook. Names are looked up when a message is sent, and again each time.
///
/// # Errors
/// Returns the fault of the address.
pub fn check_url(text: &str, allows_private: bool) -> Result<String, String> {
    if text.chars().count() > LIMITS.webhook_url_chars {
        return Err(format!("longer than {} characters", LIMITS.webhook_url_chars));
    }
    let url =
        Url::parse(text).map_err(|error| format!("expected a URL, such as https://lab.example/events: {error}"))?;
    match url.scheme() {
        "https" => {}
        "http" if allows_private => {}
        "http" => return Err("expected https; the operator of this service does not allow http".to_owned()),
        other => return Err(format!("expected https, found {other:?}")),
    }
    if !url.username().is_empty() || url.password().is_some() {
        return Err("a URL with a user name or a password is not allowed; messages are signed instead".to_owned());
    }
    let host = url.host_str().unwrap_or_default();
    let address: Option<IpAddr> = host.trim_start_matches('[').trim_end_matches(']').parse().ok();
    if !allows_private && address.is_some_and(|address| !is_public(address)) {
        return Err(format!("{host} is not an address of the public internet"));
    }
    Ok(url.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(url: &str, allows_private: bool) -> Option<String> {
        let (mut faults, draft) = (Faults::new(), WebhookDraft { url: url.to_owned(), events: None });
        check(&draft, allows_private, &mut faults);
        faults.list().first().map(ToString::to_string)
    }

    #[test]
    fn addresses_are_checked() {
        for url in ["https://lab.example/a?b=c", "https://[2606:4700:4700::1111]:8443/", "https://1.1.1.1"] {
            assert_eq!(told(url, false), None, "{url}");
        }
        for (url, fault) in [
            ("lab.example", "expected a URL"),
            ("http://lab.example/", "does not allow http"),
            ("ftp://lab.example/", "expected https, found \"ftp\""),
            ("https://me:secret@lab.example/", "password"),
            ("https://127.0.0.1/", "127.0.0.1 is not an address of the public internet"),
            ("https://2130706433/", "127.0.0.1 is not"),
            ("https://0x7f.1/", "127.0.0.1 is not"),
            ("https://[::1]/", "is not an address of the public"),
            ("https://[::ffff:10.0.0.1]/", "is not an address of the public"),
        ] {
            let found = told(url, false).unwrap_or_default();
            assert!(found.starts_with("/url: ") && found.contains(fault), "{url}: {found}");
        }
        assert_eq!(told("http://127.0.0.1:9000/", true), None);
        let long = format!("https://lab.example/{}", "a".repeat(LIMITS.webhook_url_chars));
        assert!(told(&long, false).unwrap().contains("longer than"));
    }
}
