//! The guide for agents (`/v1/agent-guide`).

use axum::Json;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};

use crate::actions::Profile;
use crate::app::guide::Guide;
use crate::http::extract::params::Params;

/// The guide, in parts.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct AgentGuide {
    /// Profile that the guide is about; name it when the answers are sent.
    pub profile: Profile,
    /// The whole guide as Markdown: a system prompt.
    pub text: String,
    /// What is true of the world, a sentence each.
    pub world: Vec<&'static str>,
    /// What an answer must be, a sentence each.
    pub answer: Vec<&'static str>,
    /// Limits on an answer, a sentence each.
    pub limits: Vec<String>,
    /// Functions worth calling; `/v1/profiles` lists all.
    pub functions: Vec<&'static str>,
    /// An answer as it should be.
    pub example: &'static str,
}

/// Format of the guide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum GuideFormat {
    /// The parts as JSON.
    Json,
    /// Markdown.
    Markdown,
}

/// Query parameters of the guide.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct GuideQuery {
    /// Rules under which the answers will become builds; `mindcraft` by default.
    #[param(inline)]
    profile: Option<Profile>,
    /// `json`, unless `Accept` asks for `text/markdown`.
    #[param(inline)]
    format: Option<GuideFormat>,
}

/// Returns a system prompt for agents.
///
/// A lab can use it as it stands. It describes the world, what an answer must be, limits and functions, and has an
/// example.
#[utoipa::path(
    get, path = "/v1/agent-guide", operation_id = "get_agent_guide", tag = "tasks", summary = "Get a system prompt for agents",
    params(GuideQuery),
    responses(
        (status = 200, description = "The guide, as JSON or Markdown",
         content((AgentGuide = "application/json", example = json!({ "profile": "mindcraft", "text": "You are …" })),
                 (String = "text/markdown", example = json!("You are a construction engineer …")))),
    )
)]
pub async fn get_agent_guide(headers: HeaderMap, Params(query): Params<GuideQuery>) -> Response {
    let profile = query.profile.unwrap_or(Profile::Mindcraft);
    let guide = Guide::of(profile);
    let accepted = headers.get(header::ACCEPT).and_then(|accepted| accepted.to_str().ok()).unwrap_or_default();
    let is_markdown = match query.format {
        Some(format) => format == GuideFormat::Markdown,
        None => accepted.contains("text/markdown"),
    };
    if is_markdown {
        let kind = HeaderValue::from_static("text/markdown; charset=utf-8");
        return ([(header::CONTENT_TYPE, kind)], guide.markdown()).into_response();
    }
    Json(AgentGuide {
        profile,
        text: guide.markdown(),
        world: guide.world.to_vec(),
        answer: guide.answer.to_vec(),
        limits: guide.limits(),
        functions: guide.functions().collect(),
        example: guide.example,
    })
    .into_response()
}
