//! Pages of hidden evaluation: epochs, their commitments and boards, and instructions for entering and verifying.

use askama::Template;
use axum::extract::{Path, State};

use super::html::{self, PageResult};
use crate::app::error::AppResult;
use crate::app::hidden::boards::{TierBoard, board_of};
use crate::app::hidden::epochs;
use crate::app::hidden::receipts::verifying_keys;
use crate::clock::{milliseconds, now_ms};
use crate::http::extract::origin::Origin;
use crate::http::hidden::epochs::EpochBody;
use crate::http::state::AppState;
use plumbline_engine::hidden::beacon::Beacon;
use plumbline_engine::hidden::feedback::Tier;

/// An epoch with the derived values that pages show.
struct Shown {
    body: EpochBody,
    /// Next opening or closing; `None` once the epoch is closed.
    next: Option<Next>,
    /// Elapsed share of the time from opening to closing, from 0 to 1; 1 once the epoch is closed.
    passed: f64,
}

/// Next opening or closing of an epoch.
pub struct Next {
    /// What it does: `opens` or `closes`.
    pub what: &'static str,
    /// Time at which it does, in RFC 3339.
    pub at: String,
    /// Time left, such as `1 d 1 h`.
    pub left: String,
}

/// Returns the epoch that opens or closes next, if there is one.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn next_of(state: &AppState) -> AppResult<Option<(String, Next)>> {
    let now = now_ms();
    let mut all = Vec::new();
    for epoch in epochs::epochs(state).await? {
        let shown = Shown::of(EpochBody::from(epoch), now);
        all.extend(shown.next.map(|next| (shown.body.id, next)));
    }
    Ok(all.into_iter().min_by(|(_, a), (_, b)| a.at.cmp(&b.at)))
}

impl Shown {
    fn of(body: EpochBody, now_ms: i64) -> Self {
        let at = |time: &str| milliseconds(time).unwrap_or(now_ms);
        let (opens, closes) = (at(&body.opens_at), at(&body.closes_at));
        let next = match body.state {
            "committed" => Some(("opens", &body.opens_at, opens)),
            "open" => Some(("closes", &body.closes_at, closes)),
            _ => None,
        };
        Self {
            next: next.map(|(what, time, at)| Next { what, at: time.clone(), left: span(at - now_ms) }),
            passed: if body.state == "closed" {
                1.0
            } else {
                ((now_ms - opens) as f64 / (closes - opens).max(1) as f64).clamp(0.0, 1.0)
            },
            body,
        }
    }

    /// Returns the beacon whose round is due, but has not been brought.
    fn missing(&self) -> Option<&Beacon> {
        let due = self.body.registration_closes_at.as_deref().and_then(milliseconds)?;
        let is_missing = self.body.pool.is_none() && self.body.state != "closed" && due <= now_ms();
        self.body.commitment.beacon.as_ref().filter(|_| is_missing)
    }

    /// Returns the spent share of the information budget, at most 1.
    fn spent(&self) -> f64 {
        (self.body.released_bits / self.body.budget_bits.max(1.0)).min(1.0)
    }
}

/// Formats a duration in milliseconds with at most two units, such as `1 d 1 h`.
fn span(ms: i64) -> String {
    let seconds = (ms / 1_000).max(0);
    let units = [(seconds / 86_400, "d"), (seconds / 3_600 % 24, "h"), (seconds / 60 % 60, "min"), (seconds % 60, "s")];
    let told = units.iter().skip_while(|(count, _)| *count == 0).take(2);
    let told: Vec<String> = told.map(|(count, unit)| format!("{count} {unit}")).collect();
    if told.is_empty() { "0 s".to_owned() } else { told.join(" ") }
}

#[derive(Template)]
#[template(path = "epochs.html")]
struct EpochsPage {
    epochs: Vec<Shown>,
    origin: Origin,
    /// Public keys of receipts, from the first to the one in use.
    keys: Vec<String>,
}

/// Serves the list of epochs with instructions for entering one and verifying its reveal.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn epochs(State(state): State<AppState>, origin: Origin) -> PageResult {
    let epochs = epochs::epochs(&state).await?;
    html::page(&EpochsPage {
        epochs: epochs.into_iter().map(|epoch| Shown::of(epoch.into(), now_ms())).collect(),
        origin,
        keys: verifying_keys(&state).await?.all,
    })
}

#[derive(Template)]
#[template(path = "epoch.html")]
struct EpochPage {
    epoch: Shown,
    origin: Origin,
    boards: [(&'static str, TierBoard); 2],
}

/// Serves the page of an epoch: its commitment, its schedule and its boards.
///
/// # Errors
/// Returns a 404 error if no epoch has this name.
pub async fn epoch(State(state): State<AppState>, origin: Origin, Path(id): Path<String>) -> PageResult {
    let epoch = epochs::epoch(&state, &id).await?;
    let boards = [
        ("Official board", board_of(&state, &epoch.row, Tier::Official).await?),
        ("Development board", board_of(&state, &epoch.row, Tier::Dev).await?),
    ];
    html::page(&EpochPage { epoch: Shown::of(epoch.into(), now_ms()), origin, boards })
}

#[cfg(test)]
mod tests {
    use super::span;

    #[test]
    fn time_is_told_to_two_units() {
        assert_eq!(span(90_061_000), "1 d 1 h");
        assert_eq!(span(3_600_000 + 120_000), "1 h 2 min");
        assert_eq!(span(-5), "0 s");
        assert_eq!(span(59_999), "59 s");
    }
}
