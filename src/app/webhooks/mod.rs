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
    pub const RETRY_SECONDS: [u64; 9] = [5, 300, 1_800, 7_200, 18_000, 36_000, 50_400, 72_000, 86_400];
}

impl Default for WebhookSettings {
    fn default() -> Self {
        Self { allows_private: false, retries: Self::RETRY_SECONDS.map(Duration::from_secs).into() }
    }
}
