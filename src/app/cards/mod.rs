//! Cards of runs and entries: what was evaluated, as its owner declares it. Later edits are kept as versions.

pub mod card;
pub mod reading;

use std::collections::HashMap;

use serde_json::Value;
use uuid::Uuid;

use self::card::Card;
use super::App;
use super::access::Caller;
use super::error::{AppError, AppResult};
use super::hidden::entries::stored_entry;
use super::limits::LIMITS;
use super::runs::read::stored;
use crate::clock::now_ms;
use crate::store::cards::{CardOf, CardRow, NewCard};
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// A card in the form in which it is stored: the text of the system prompt apart.
#[derive(Debug)]
pub struct StoredForm {
    /// The card as JSON.
    pub card: Value,
    /// Text of the system prompt.
    pub system_prompt: Option<String>,
}

impl From<Card> for StoredForm {
    fn from(mut card: Card) -> Self {
        let system_prompt = card.system_prompt.as_mut().and_then(|prompt| prompt.text.take());
        Self { card: serde_json::to_value(card).expect("a card is JSON"), system_prompt }
    }
}

/// Adds a version of the card of a run or an entry, also if it has ended. Returns all versions, latest first. The card
/// is
/// `None` if it cannot be read; `faults` holds its faults.
///
/// # Errors
/// Returns an error if there is no such run or entry, if it belongs to another owner, all faults of the card, or a
/// conflict if there are too many versions.
pub async fn put(
    app: &App,
    caller: &Caller,
    of: CardOf<'_>,
    card: Option<Card>,
    faults: Faults,
) -> AppResult<Vec<CardRow>> {
    caller.require(Scope::Submit)?;
    let owner = owner_of(app, of).await?;
    caller.require_own(owner.as_deref(), if matches!(of, CardOf::Run(_)) { "run" } else { "entry" })?;
    let (Some(card), true) = (card, faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let StoredForm { card, system_prompt } = card.into();
    let (id, system_prompt) = (Uuid::now_v7().to_string(), system_prompt.as_deref());
    let new = NewCard { id: &id, card: &card, system_prompt, actor: caller.owner() };
    if app.store.add_card(of, &new, LIMITS.card_versions, now_ms()).await?.is_none() {
        let detail = format!("the card has {} versions, the maximum", LIMITS.card_versions);
        return Err(AppError::conflict("card-full", detail));
    }
    Ok(app.store.cards(of).await?)
}

/// Returns all versions of the card of a run or an entry, latest first.
///
/// # Errors
/// Returns an error (404) if there is no such run or entry, if it has no card, or if it is under embargo and not the
/// caller's.
pub async fn versions(app: &App, caller: Option<&Caller>, of: CardOf<'_>) -> AppResult<Vec<CardRow>> {
    match of {
        CardOf::Run(id) => {
            let run = stored(app, id).await?;
            if run.embargo.is_some() && !caller.is_some_and(|caller| caller.sees_all_of(run.owner.as_deref())) {
                return Err(AppError::not_found(
                    "the run is under embargo; until its end only its owner sees its card",
                ));
            }
        }
        CardOf::Entry(id) => drop(stored_entry(app, id).await?),
    }
    let versions = app.store.cards(of).await?;
    if versions.is_empty() {
        return Err(AppError::not_found("it has no card yet"));
    }
    Ok(versions)
}

/// Returns the cards of runs that everybody may see, by run.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn of_runs(app: &App, runs: &[&str]) -> AppResult<HashMap<String, Card>> {
    let stored = app.store.latest_cards(runs).await?;
    let read = |(run, card): (String, Value)| match serde_json::from_value(card) {
        Ok(card) => Some((run, card)),
        Err(error) => {
            tracing::error!(%error, run, "the stored card of a run cannot be read");
            None
        }
    };
    Ok(stored.into_iter().filter_map(read).collect())
}

/// Returns the owner of what a card is about; none if it was made without a key.
async fn owner_of(app: &App, of: CardOf<'_>) -> AppResult<Option<String>> {
    match of {
        CardOf::Run(id) => Ok(stored(app, id).await?.owner),
        CardOf::Entry(id) => Ok(Some(stored_entry(app, id).await?.owner).filter(|owner| !owner.is_empty())),
    }
}
