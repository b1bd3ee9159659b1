//! Webhooks: events of an owner, posted to its own addresses by the convention of Standard Webhooks
//! (<https://www.standardwebhooks.com/>, signatures of version 1).
//!
//! A message has the headers `webhook-id`, `webhook-timestamp` and `webhook-signature`. It is delivered at least once;
//! `webhook-id` tells repetitions apart.

pub mod addresses;
pub mod body;
pub mod delivering;
pub mod manage;
pub mod message;

use std::time::Duration;

/// Settings of webhooks.
#[derive(Debug, Clone)]
pub struct WebhookSettings {
    /// Whether webhooks may lead to private addresses, and need no TLS.
    pub allows_private: bool,
    /// Pauses between the attempts of a delivery; after the last of them, one more attempt is made.
    pub retries: Vec<Duration>,
}

impl WebhookSettings {
    /// Pauses between attempts in seconds, as Standard Webhooks suggests them.
    pub const RETRY_TEXT: &str = "5,300,1800,7200,18000,36000,50400,72000,86400";
}

impl Default for WebhookSettings {
    fn default() -> Self {
        let seconds = |text: &str| Duration::from_secs(text.parse().expect("the pauses are numbers"));
        Self { allows_private: false, retries: Self::RETRY_TEXT.split(',').map(seconds).collect() }
    }
}
