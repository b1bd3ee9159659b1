//! Reading webhooks that requests describe.

use std::net::IpAddr;

use reqwest::Url;
use serde_json::Value;

use super::addresses::is_public;
use super::message::WebhookEvent;
use crate::app::accounts::body::read_words;
use crate::app::body::request_body;
use crate::app::body::values::Json;
use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::Text;

request_body! {
    /// A webhook to create.
    #[schema(as = NewWebhook, example = json!({ "url": "https://lab.example/plumbline", "events": ["run.finished"] }))]
    pub struct NewWebhookBody: "an object with \"url\"" {
        /// URL to which events are posted: https, at an address of the public internet.
        #[schema(value_type = String)]
        url: String = required(url_text),
        /// Events to post; all by default.
        #[schema(value_type = Option<Vec<WebhookEvent>>)]
        events: Vec<WebhookEvent> = optional(|faults| Json { faults, read: read_events }),
    }
    unknown: |_| "unknown field; a webhook has url and events"
}

request_body! {
    /// Settings of a webhook. What is left out stays as it is.
    #[schema(as = WebhookChange, example = json!({ "url": "https://lab.example/plumbline", "enabled": true }))]
    pub struct WebhookChangeBody: "an object with \"url\", \"events\" and \"enabled\"" {
        /// URL to which events are posted: https, at an address of the public internet.
        url: String = optional(url_text),
        /// Events to post.
        #[schema(value_type = Option<Vec<WebhookEvent>>)]
        events: Vec<WebhookEvent> = optional(|faults| Json { faults, read: read_events }),
        /// Whether events are posted. Enabling a webhook goes on with the events from then on, and with the messages
        /// that were pending when it was disabled.
        enabled: bool = optional(|faults| Json { faults, read: read_flag }),
    }
    unknown: |_| "unknown field; a webhook has url, events and enabled"
}

const fn url_text(faults: &mut Faults) -> Text<'_> {
    Text { faults, min_chars: 1, max_chars: LIMITS.webhook_url_chars }
}

fn read_events(value: &Value, faults: &mut Faults) -> Option<Vec<WebhookEvent>> {
    read_words(value, &WebhookEvent::ALL.map(|event| (event.name(), event)), faults)
}

fn read_flag(value: &Value, faults: &mut Faults) -> Option<bool> {
    let flag = value.as_bool();
    if flag.is_none() {
        faults.add("expected true or false");
    }
    flag
}

/// Returns the names of events by commas, in the order of the contract; empty for all.
#[must_use]
pub fn names_of(events: Option<&[WebhookEvent]>) -> String {
    let chosen = events.unwrap_or_default();
    let names = WebhookEvent::ALL.into_iter().filter(|event| chosen.contains(event)).map(WebhookEvent::name);
    names.collect::<Vec<_>>().join(",")
}

/// Checks the address of a webhook. Names are looked up when a message is sent, and again each time.
///
/// # Errors
/// Returns the fault of the address.
pub fn check_url(text: &str, allows_private: bool) -> Result<String, String> {
    let url = Url::parse(text).map_err(|_| "expected a URL, such as https://lab.example/events".to_owned())?;
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
        check_url(url, allows_private).err()
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
            assert!(found.contains(fault), "{url}: {found}");
        }
        assert_eq!(told("http://127.0.0.1:9000/", true), None);
    }
}
