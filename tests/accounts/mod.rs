//! Keys, quotas, rates and events.

mod keys;
mod quota_and_events;
mod teams;
mod webhooks;
