//! Messages to webhooks and their signatures.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use serde::{Deserialize, Serialize};
use sha2::Sha256;
use uuid::Uuid;

use crate::app::App;
use crate::app::accounts::events::EventBody;
use crate::clock::rfc3339;
use crate::store::events::EventRow;
use crate::store::webhooks::WebhookRow;

/// Prefix of secrets.
const PREFIX: &str = "whsec_";

/// Event that a webhook may receive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub enum WebhookEvent {
    /// A submission was graded.
    #[serde(rename = "submission.graded")]
    SubmissionGraded,
    /// A submission was rejected.
    #[serde(rename = "submission.rejected")]
    SubmissionRejected,
    /// Grading a submission failed because of an internal error.
    #[serde(rename = "submission.grader_error")]
    SubmissionGraderError,
    /// A submission was cancelled.
    #[serde(rename = "submission.cancelled")]
    SubmissionCancelled,
    /// A run finished.
    #[serde(rename = "run.finished")]
    RunFinished,
    /// A run was deleted.
    #[serde(rename = "run.deleted")]
    RunDeleted,
}

impl WebhookEvent {
    /// All events.
    pub const ALL: [Self; 6] = [
        Self::SubmissionGraded,
        Self::SubmissionRejected,
        Self::SubmissionGraderError,
        Self::SubmissionCancelled,
        Self::RunFinished,
        Self::RunDeleted,
    ];

    /// Returns the name of the event in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SubmissionGraded => "submission.graded",
            Self::SubmissionRejected => "submission.rejected",
            Self::SubmissionGraderError => "submission.grader_error",
            Self::SubmissionCancelled => "submission.cancelled",
            Self::RunFinished => "run.finished",
            Self::RunDeleted => "run.deleted",
        }
    }
}

/// Name of the message that tries a webhook out.
pub const TEST: &str = "webhook.test";

/// Message to a webhook.
#[derive(Debug, Serialize)]
struct Message<'a, T> {
    #[serde(rename = "type")]
    name: &'a str,
    timestamp: String,
    data: T,
}

/// Creates the identifier of a message, which is the same in every attempt to deliver it.
#[must_use]
pub fn new_message_id() -> String {
    format!("msg_{}", Uuid::now_v7().simple())
}

/// Returns the name of a stored event.
#[must_use]
pub fn name_of(row: &EventRow) -> String {
    let what = if row.submission_id.is_some() { "submission" } else { "run" };
    format!("{what}.{}", row.state)
}

/// Returns the message of a stored event as JSON.
#[must_use]
pub fn message_of(app: &App, row: &EventRow) -> String {
    let message = Message { name: &name_of(row), timestamp: rfc3339(row.at_ms), data: EventBody::of(app, row) };
    serde_json::to_string(&message).expect("a message is JSON")
}

/// Returns the message that tries a webhook out, as JSON.
#[must_use]
pub fn test_message(webhook_id: &str, now_ms: i64) -> String {
    let data = serde_json::json!({ "webhook": webhook_id });
    serde_json::to_string(&Message { name: TEST, timestamp: rfc3339(now_ms), data }).expect("a message is JSON")
}

/// Creates a secret of 256 random bits.
///
/// # Errors
/// Returns an error if the system has no random numbers.
pub fn new_secret() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes)?;
    Ok(format!("{PREFIX}{}", BASE64_STANDARD.encode(bytes)))
}

/// Signs a message with the secrets of a webhook that hold now. Returns the value of `webhook-signature`.
#[must_use]
pub fn signatures(webhook: &WebhookRow, id: &str, seconds: i64, body: &str, now_ms: i64) -> String {
    let old = webhook.old_secret.as_deref().filter(|_| webhook.old_secret_until_ms.is_some_and(|end| now_ms < end));
    let secrets = std::iter::once(webhook.secret.as_str()).chain(old);
    secrets.map(|secret| signature(secret, id, seconds, body)).collect::<Vec<_>>().join(" ")
}

fn signature(secret: &str, id: &str, seconds: i64, body: &str) -> String {
    let key = BASE64_STANDARD
        .decode(secret.strip_prefix(PREFIX).unwrap_or(secret))
        .expect("secrets are made by `new_secret`, in Base64");
    let mut mac = Hmac::<Sha256>::new_from_slice(&key).expect("HMAC takes keys of any length");
    mac.update(format!("{id}.{seconds}.{body}").as_bytes());
    format!("v1,{}", BASE64_STANDARD.encode(mac.finalize().into_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::states::{RunState, SubmissionState};

    /// The vector of the reference implementations of Standard Webhooks.
    #[test]
    fn signatures_are_those_of_standard_webhooks() {
        let secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
        let signed = signature(secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, r#"{"test": 2432232314}"#);
        assert_eq!(signed, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn names_of_events_are_those_of_the_contract() {
        for event in WebhookEvent::ALL {
            assert_eq!(serde_json::to_value(event).unwrap(), event.name());
        }
    }

    #[test]
    fn a_webhook_may_choose_every_end_of_a_submission_or_a_run() {
        let goes_on = |state: &SubmissionState| matches!(state, SubmissionState::Queued | SubmissionState::Grading);
        let submissions = SubmissionState::ALL.into_iter().filter(|state| !goes_on(state));
        let runs = RunState::ALL.into_iter().filter(|state| !matches!(state, RunState::Open | RunState::Finishing));
        let ends = submissions
            .map(|state| format!("submission.{}", state.name()))
            .chain(runs.map(|state| format!("run.{}", state.name())));
        assert_eq!(ends.collect::<Vec<_>>(), WebhookEvent::ALL.map(WebhookEvent::name));
    }

    #[test]
    fn an_old_secret_signs_until_its_end() {
        let webhook = WebhookRow {
            id: String::new(),
            owner: String::new(),
            url: String::new(),
            events: String::new(),
            secret: new_secret().unwrap(),
            old_secret: Some(new_secret().unwrap()),
            old_secret_until_ms: Some(1_000),
            disabled_reason: None,
            seen_event: 0,
            created_at_ms: 0,
        };
        assert_eq!(signatures(&webhook, "msg", 1, "{}", 999).split(' ').count(), 2);
        assert_eq!(signatures(&webhook, "msg", 1, "{}", 1_000).split(' ').count(), 1);
    }
}
