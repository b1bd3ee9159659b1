//! `/v1/team`: the members of an owner, and their keys.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::Serialize;

use crate::app::access::Caller;
use crate::app::accounts::body::{NewKeyBody, NewMemberBody};
use crate::app::accounts::team::{self, CreatedKey, Team};
use crate::app::error::AppResult;
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::{KeyRow, Role, Scope};
use crate::store::members::MemberRow;
use plumbline_engine::intake::Faults;

/// An owner with its members.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct TeamBody {
    /// Name of the owner, to whom runs and submissions belong.
    pub owner: String,
    /// Live keys of the owner itself, oldest first.
    pub keys: Vec<KeyBody>,
    /// Members, by name.
    pub members: Vec<MemberBody>,
}

/// A member of an owner.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct MemberBody {
    /// Name of the member.
    pub name: String,
    /// Role of the member: what its keys may do at most.
    pub role: Role,
    /// Time at which the member was added.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Live keys of the member, oldest first.
    pub keys: Vec<KeyBody>,
}

/// A key, without its secret.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct KeyBody {
    /// Public part of the key.
    #[schema(example = "1f0c2d3e4b5a")]
    pub id: String,
    /// Scopes of the key; the role of its member may allow less.
    pub scopes: Vec<Scope>,
    /// Time of creation.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which the key expires; null if it does not.
    #[schema(format = DateTime)]
    pub expires_at: Option<String>,
    /// Time of the last use, to the minute; null before the first.
    #[schema(format = DateTime)]
    pub last_used_at: Option<String>,
}

impl From<&KeyRow> for KeyBody {
    fn from(key: &KeyRow) -> Self {
        Self {
            id: key.id.clone(),
            scopes: key.scopes.clone(),
            created_at: rfc3339(key.created_at_ms),
            expires_at: key.expires_at_ms.map(rfc3339),
            last_used_at: key.last_used_at_ms.map(rfc3339),
        }
    }
}

impl From<Team> for TeamBody {
    fn from(Team { owner, members, keys }: Team) -> Self {
        let keys_of = |member: Option<&str>| {
            keys.iter().filter(|key| key.member.as_deref() == member).map(KeyBody::from).collect::<Vec<_>>()
        };
        let member = |MemberRow { name, role, created_at_ms }: MemberRow| MemberBody {
            keys: keys_of(Some(&name)),
            created_at: rfc3339(created_at_ms),
            name,
            role,
        };
        Self { keys: keys_of(None), members: members.into_iter().map(member).collect(), owner }
    }
}

/// Returns the team of the caller's owner.
///
/// A team has its members, and the live keys of all.
#[utoipa::path(
    get, path = "/v1/team", operation_id = "get_team", tag = "service", summary = "Get a team",
    security(("key" = [])),
    responses(
        (status = 200, description = "The team", body = TeamBody,
         example = json!({ "owner": "lab", "keys": [], "members": [
             { "name": "trainer", "role": "submitter", "created_at": "2026-11-21T07:00:00.000Z", "keys": [] }] })),
        (status = 401, description = "No key, or none that is live"),
    )
)]
pub async fn get_team(State(state): State<AppState>, caller: Caller) -> AppResult<Json<TeamBody>> {
    Ok(Json(team::team(&state, &caller).await?.into()))
}

/// Adds a member to the team, or changes its role.
///
/// A role holds for the member's keys at once. The caller's key must be the owner's own, or a manager's.
#[utoipa::path(
    put, path = "/v1/team/members/{name}", operation_id = "put_member", tag = "service",
    summary = "Add a member, or change its role",
    params(("name" = String, Path, description = "Name of the member", example = "trainer")),
    request_body(content = NewMemberBody, content_type = "application/json"),
    responses(
        (status = 200, description = "The team; the member existed", body = TeamBody,
         example = json!({ "owner": "lab", "keys": [], "members": [] })),
        (status = 201, description = "The team; the member was added", body = TeamBody,
         example = json!({ "owner": "lab", "keys": [], "members": [] })),
        (status = 400, description = "The name is faulty"),
        (status = 409, description = "The team is full"),
    )
)]
pub async fn put_member(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    body: JsonBody,
) -> AppResult<(StatusCode, Json<TeamBody>)> {
    caller.require_manager()?;
    let (draft, faults) = read_draft::<NewMemberBody>(&body, "put one member per request")?;
    let is_new = team::put_member(&state, &caller, &name, draft, faults).await?;
    let status = if is_new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, Json(team::team(&state, &caller).await?.into())))
}

/// Removes a member from the team.
///
/// The member's keys are revoked, and the service rejects them within half a second. What they sent stays the owner's.
#[utoipa::path(
    delete, path = "/v1/team/members/{name}", operation_id = "remove_member", tag = "service",
    summary = "Remove a member",
    params(("name" = String, Path, description = "Name of the member", example = "trainer")),
    responses(
        (status = 200, description = "The team", body = TeamBody,
         example = json!({ "owner": "lab", "keys": [], "members": [] })),
    )
)]
pub async fn remove_member(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
) -> AppResult<Json<TeamBody>> {
    team::remove_member(&state, &caller, &name).await?;
    Ok(Json(team::team(&state, &caller).await?.into()))
}

/// A key that was created.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = NewKeyBody)]
pub struct CreatedKeyBody {
    /// The whole key. It is shown only here: the service keeps a hash of its secret.
    pub key: String,
    /// The key without its secret.
    pub about: KeyBody,
}

/// Creates a key of a member.
///
/// A member may create keys of its own; the owner's own keys and managers those of everyone. The key of the request
/// needs the scope `submit`. A new key has no scope that it lacks, and does not outlive it.
#[utoipa::path(
    post, path = "/v1/team/members/{name}/keys", operation_id = "create_member_key", tag = "service",
    summary = "Create a key of a member",
    params(("name" = String, Path, description = "Name of the member", example = "trainer")),
    request_body(content = Option<NewKeyBody>, content_type = "application/json"),
    responses(
        (status = 201, description = "The key", body = CreatedKeyBody,
         example = json!({ "key": "plk_1f0c2d3e4b5a_…", "about": { "id": "1f0c2d3e4b5a", "scopes": ["submit"],
             "created_at": "2026-11-21T07:00:00.000Z", "expires_at": null, "last_used_at": null } })),
        (status = 409, description = "The member has too many live keys"),
    )
)]
pub async fn create_member_key(
    State(state): State<AppState>,
    caller: Caller,
    Path(name): Path<String>,
    body: Option<JsonBody>,
) -> AppResult<(StatusCode, Json<CreatedKeyBody>)> {
    caller.require_owner()?;
    let (draft, faults) = match &body {
        Some(body) => read_draft::<NewKeyBody>(body, "create one key per request")?,
        None => (Some(NewKeyBody::default()), Faults::new()),
    };
    let CreatedKey { key, row } = team::create_key(&state, &caller, &name, draft, faults).await?;
    Ok((StatusCode::CREATED, Json(CreatedKeyBody { key, about: KeyBody::from(&row) })))
}

/// Revokes a key of the team.
///
/// The service rejects it within half a second. A member may revoke keys of its own.
#[utoipa::path(
    delete, path = "/v1/team/keys/{id}", operation_id = "revoke_team_key", tag = "service", summary = "Revoke a key",
    params(("id" = String, Path, description = "Public part of the key", example = "1f0c2d3e4b5a")),
    responses(
        (status = 200, description = "The team", body = TeamBody,
         example = json!({ "owner": "lab", "keys": [], "members": [] })),
    )
)]
pub async fn revoke_team_key(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<TeamBody>> {
    team::revoke_key(&state, &caller, &id).await?;
    Ok(Json(team::team(&state, &caller).await?.into()))
}
