//! Accounts: quotas, teams, webhooks, and streams of events.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod deliveries;
pub mod event_feed;
pub mod events;
pub mod quota;
pub mod team;
pub mod webhooks;
