//! The permanent public record of actions on board rows, and an Atom feed of the news of a board.

use askama::Template;
use axum::Json;
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};

use crate::app::access::Caller;
use crate::app::boards::actions::{Action, HideOrRestore, act, past};
use crate::app::boards::agents::telling;
use crate::app::boards::cache::Board;
use crate::app::boards::news::{News, news};
use crate::app::boards::read;
use crate::app::error::{AppError, AppResult};
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::extract::origin::Origin;
use crate::http::state::AppState;
use crate::store::board_actions::ActionKind;
use crate::store::boards::ActionRow;
use crate::store::keys::Scope;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::text::counted;

/// Kind of an action on a row.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[schema(as = ActionKind)]
#[serde(rename_all = "snake_case")]
pub enum KindOfAction {
    /// Removes the row from the board.
    Hide,
    /// Shows a hidden row again.
    Restore,
    /// Grades the run again.
    Regrade,
    /// Withdraws the run; its owner acts.
    Withdraw,
    /// Lifts the embargo of the run.
    Reveal,
}

/// An action on a row.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BoardAction {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub run: String,
    /// `hide`, `restore`, `regrade`, `withdraw` or `reveal`.
    #[schema(value_type = KindOfAction, example = "hide")]
    pub action: String,
    /// Owner of the key that the request was sent with; `its owner` while the run is under embargo, `the service` for
    /// the end of an embargo.
    pub actor: String,
    /// Reason for the action.
    pub reason: String,
    /// Time of the action.
    #[schema(format = DateTime)]
    pub at: String,
}

impl From<&ActionRow> for BoardAction {
    fn from(row: &ActionRow) -> Self {
        Self {
            run: row.run_id.clone(),
            action: row.action.clone(),
            actor: row.actor.clone(),
            reason: row.reason.clone(),
            at: rfc3339(row.at_ms),
        }
    }
}

impl From<Action> for BoardAction {
    fn from(Action { run, kind, actor, reason, at_ms }: Action) -> Self {
        Self { run, action: ActionKind::from(kind).name().to_owned(), actor, reason, at: rfc3339(at_ms) }
    }
}

/// All actions on the rows of a board.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BoardActions {
    /// Actions, latest first.
    pub actions: Vec<BoardAction>,
}

/// Lists every action on rows of a board.
///
/// Each action comes with its actor and reason: hiding, restoring and regrading by the operator, withdrawals by
/// owners, and the end of embargoes. The record is permanent.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/actions", operation_id = "list_board_actions", tag = "leaderboards",
    summary = "List actions on rows",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft")),
    responses(
        (status = 200, description = "Actions, latest first", body = BoardActions, example = json!({ "actions": [] })),
    )
)]
pub async fn list_board_actions(
    State(state): State<AppState>,
    Path(suite): Path<String>,
) -> AppResult<Json<BoardActions>> {
    let board = read::board(&state, &suite).await?;
    Ok(Json(BoardActions { actions: board.actions.iter().rev().map(BoardAction::from).collect() }))
}

/// A new action on a row.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "action": "hide", "reason": "the logs are another agent's" }))]
pub struct NewBoardAction {
    /// `hide` or `restore`.
    action: HideOrRestore,
    /// Reason for the action; it is public.
    #[schema(min_length = 1)]
    reason: String,
}

/// Hides a finished run from its board, or shows it again.
///
/// Requires the scope `admin`; the actor and the reason are public and permanent.
#[utoipa::path(
    post, path = "/v1/runs/{id}/board-actions", operation_id = "create_board_action", tag = "leaderboards",
    summary = "Hide or restore a run",
    params(("id" = String, Path, description = "The run's id")),
    request_body(content = NewBoardAction, content_type = "application/json"),
    responses(
        (status = 200, description = "The action", body = BoardAction,
         example = json!({ "run": "0198c0de-0000-7000-8000-000000000000", "action": "hide", "actor": "operator",
                           "reason": "the logs are another agent's", "at": "2026-11-21T07:00:00.000Z" })),
        (status = 409, description = "It is so already"),
    )
)]
pub async fn create_board_action(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<BoardAction>> {
    // A caller without the scope is refused before the body is read.
    caller.require(Scope::Admin)?;
    let new: NewBoardAction = read_json(&body)?;
    Ok(Json(act(&state, &caller, id, new.action, &new.reason).await?.into()))
}

/// An entry of the feed.
struct Entry {
    id: String,
    title: String,
    text: String,
    at_ms: i64,
    link: String,
    /// Path of a picture of the run's build that the fewest others match.
    picture: Option<String>,
}

#[derive(Template)]
#[template(path = "board.xml")]
struct Feed {
    suite: String,
    origin: Origin,
    updated: String,
    entries: Vec<Entry>,
}

impl Entry {
    fn of(news: News, board: &Board) -> Self {
        let (id, at_ms) = (format!("urn:plumbline:{}", news.name()), news.at_ms());
        match news {
            News::Finished(row) => {
                let rate = row.rate().map_or_else(|| "n/a".to_owned(), |rate| format!("{:.1} %", rate * 100.0));
                Self {
                    id,
                    title: format!("{}: {rate} overall", row.agent),
                    text: format!(
                        "A run finished with {} solved.",
                        counted(row.summary.problem_level.overall.pass, "problem")
                    ),
                    at_ms,
                    link: format!("/runs/{}", row.run),
                    picture: picture_of(&row, board),
                }
            }
            News::Acted(action) => Self {
                id,
                title: title_of(&action, board),
                link: format!("/runs/{}", action.run_id),
                text: action.reason,
                picture: None,
                at_ms,
            },
        }
    }
}

/// Returns the path of a picture of a run's build for the task that the fewest others solve.
fn picture_of(row: &Standing, board: &Board) -> Option<String> {
    let place = *telling(board, row).best.first()?;
    Some(format!("/runs/{}/tasks/{}/thumbnail.png", row.run, board.entry.suite.tasks[place].number))
}

/// Says what was done to the row of a run, and by whom.
fn title_of(action: &ActionRow, board: &Board) -> String {
    let agent = board.shown_name(&action.run_id).unwrap_or("a run");
    format!("{agent}: {} by {}", past(&action.action), action.actor)
}

impl Entry {
    fn at(&self) -> String {
        rfc3339(self.at_ms)
    }
}

/// Returns the news of a board as an Atom feed.
///
/// News are finished runs and actions on rows.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/feed.atom", operation_id = "get_board_feed", tag = "leaderboards",
    summary = "Follow a board (Atom)",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft")),
    responses(
        (status = 200, description = "The feed, latest first", body = String, content_type = "application/atom+xml",
         example = "<feed xmlns=\"http://www.w3.org/2005/Atom\">…</feed>"),
    )
)]
pub async fn get_board_feed(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    origin: Origin,
) -> AppResult<Response> {
    let board = read::board(&state, &suite).await?;
    let entries: Vec<Entry> = news(&board).into_iter().map(|it| Entry::of(it, &board)).collect();
    let feed = Feed {
        suite: board.entry.id.clone(),
        origin,
        updated: rfc3339(entries.first().map_or(0, |entry| entry.at_ms)),
        entries,
    };
    let text = feed.render().map_err(|error| AppError::internal(&error))?;
    Ok(([(header::CONTENT_TYPE, "application/atom+xml; charset=utf-8")], text).into_response())
}
