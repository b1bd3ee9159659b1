//! Teams: the members of an owner, and the keys that belong to them.

use super::body::{NewKeyBody, NewMemberBody};
use crate::app::App;
use crate::app::access::{Caller, unauthorized};
use crate::app::body::{DIRECTION_FAULT, changes_direction};
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::limits::LIMITS;
use crate::clock::{DAY_MS, now_ms};
use crate::store::keys::{Holder, KeyCreated, KeyRow, LIVE_KEYS, Scope, parts};
use crate::store::members::{MemberPut, MemberRow};
use plumbline_engine::intake::Faults;

/// An owner with its members and all keys that are live.
#[derive(Debug)]
pub struct Team {
    /// Name of the owner.
    pub owner: String,
    /// Members, by name.
    pub members: Vec<MemberRow>,
    /// Live keys of the owner and of the members, oldest first.
    pub keys: Vec<KeyRow>,
}

/// A key that was created.
#[derive(Debug)]
pub struct CreatedKey {
    /// The whole key, which is never shown again.
    pub key: String,
    /// The stored key.
    pub row: KeyRow,
}

/// Checks the name of an owner or a member.
///
/// # Errors
/// Returns the fault of the name.
pub fn check_name(name: &str) -> Result<(), String> {
    if name.trim().is_empty() || name.chars().count() > LIMITS.owner_chars {
        return Err(format!("expected 1 to {} characters", LIMITS.owner_chars));
    }
    if changes_direction(name) {
        return Err(DIRECTION_FAULT.to_owned());
    }
    // A path with such a segment is shortened on its way.
    if name == "." || name == ".." {
        return Err(format!("{name:?} is not allowed"));
    }
    if name.chars().any(char::is_control) || name.trim() != name {
        return Err(format!("control characters and leading or trailing spaces are not allowed: {name:?}"));
    }
    Ok(())
}

impl Caller {
    /// Returns the owner whose key was sent.
    ///
    /// # Errors
    /// Returns 401 if no key was accepted.
    pub fn require_owner(&self) -> AppResult<&str> {
        let why = "this belongs to the owner of a key: Authorization: Bearer …";
        self.owner().ok_or_else(|| unauthorized(self.refused.unwrap_or(why)))
    }

    /// Returns the owner whose key was sent if the key may manage what belongs to it.
    ///
    /// # Errors
    /// Returns 401 if no key was accepted, and 403 if the key's scopes or the role of its member do not allow it.
    pub fn require_manager(&self) -> AppResult<&str> {
        let owner = self.require_owner()?;
        if self.key.as_ref().is_some_and(KeyRow::manages) {
            return Ok(owner);
        }
        let detail =
            "this needs a key with the scope \"submit\" of the owner itself, or of a member with the role \"manager\"";
        Err(AppError::new(Kind::Forbidden, detail))
    }
}

impl App {
    /// Returns the caller with the key as it is stored now. Requests hold a key for a moment without reading it again;
    /// whoever was just removed could make another key meanwhile, so what concerns teams reads it here.
    ///
    /// # Errors
    /// Returns 401 if no key was accepted, or if it is no longer live.
    pub async fn caller_now(&self, caller: &Caller) -> AppResult<Caller> {
        caller.require_owner()?;
        let id = caller.key.as_ref().map_or("", |key| key.id.as_str());
        let key = self.store.key(id).await?.filter(|key| key.is_live(now_ms()));
        let key = key.ok_or_else(|| unauthorized("the key is revoked or expired"))?;
        Ok(Caller { key: Some(key), ..caller.clone() })
    }

    /// Returns the owner whose key was sent if the key may manage what belongs to it now.
    ///
    /// # Errors
    /// Returns 401 if no live key was sent, and 403 if it may not manage.
    pub async fn manager<'c>(&self, caller: &'c Caller) -> AppResult<&'c str> {
        self.caller_now(caller).await?.require_manager()?;
        caller.require_owner()
    }

    /// Checks that a caller who is a member has the role of a manager now.
    ///
    /// # Errors
    /// Returns 401 or 403 if the caller is a member without that role.
    pub async fn require_manager_of_members(&self, caller: &Caller) -> AppResult<()> {
        if caller.key.as_ref().is_some_and(|key| key.member.is_some()) {
            self.manager(caller).await?;
        }
        Ok(())
    }
}

/// Returns the team of the caller's owner.
///
/// # Errors
/// Returns an error if no key was accepted, or if the database fails.
pub async fn team(app: &App, caller: &Caller) -> AppResult<Team> {
    let owner = caller.require_owner()?.to_owned();
    let now = now_ms();
    let mut keys = app.store.keys_of(&owner).await?;
    keys.retain(|key| key.is_live(now));
    Ok(Team { members: app.store.members(&owner).await?, keys, owner })
}

/// Adds a member, or changes the role of an existing one. Returns whether it was added.
///
/// # Errors
/// Returns an error if the caller may not manage the team, if the name is faulty, or if the team is full.
pub async fn put_member(
    app: &App,
    caller: &Caller,
    name: &str,
    draft: Option<NewMemberBody>,
    faults: Faults,
) -> AppResult<bool> {
    let owner = app.manager(caller).await?;
    let (Some(NewMemberBody { role: Some(role) }), true) = (draft, faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    check_name(name).map_err(|fault| AppError::new(Kind::BadRequest, format!("the name in the path: {fault}")))?;
    match app.store.put_member(owner, name, role, LIMITS.team_members, now_ms()).await? {
        MemberPut::Added => Ok(true),
        MemberPut::Changed => Ok(false),
        MemberPut::Full => {
            let detail = format!("the team has {} members, the maximum", LIMITS.team_members);
            Err(AppError::conflict("team-full", detail))
        }
    }
}

/// Removes a member; its keys are revoked.
///
/// # Errors
/// Returns an error if the caller may not manage the team, or if there is no such member.
pub async fn remove_member(app: &App, caller: &Caller, name: &str) -> AppResult<()> {
    let owner = app.manager(caller).await?;
    if app.store.remove_member(owner, name, now_ms()).await? { Ok(()) } else { Err(no_member(name)) }
}

/// Creates a key of a member. A member may create keys of its own; a manager those of everyone. The key has no scope
/// that the one of the request lacks, and does not outlive it. Without scopes, it has all that the role and that key
/// allow.
///
/// # Errors
/// Returns an error if the caller may not create it, if there is no such member, if the role does not allow a scope, or
/// if the member has too many live keys.
pub async fn create_key(
    app: &App,
    caller: &Caller,
    member: &str,
    draft: Option<NewKeyBody>,
    mut faults: Faults,
) -> AppResult<CreatedKey> {
    let caller = &app.caller_now(caller).await?;
    let owner = caller.require_owner()?;
    caller.require(Scope::Submit)?;
    let by = caller.key.as_ref().expect("a caller with an owner has a key");
    if by.member.as_deref() != Some(member) {
        caller.require_manager()?;
    }
    let members = app.store.members(owner).await?;
    let role = members.iter().find(|known| known.name == member).ok_or_else(|| no_member(member))?.role;
    // A new key gets no further than the one that makes it.
    let is_allowed = |scope: Scope| role.allows(scope) && by.allows(scope);
    let NewKeyBody { scopes, expires_days: days } = draft.unwrap_or_default();
    faults.enter_key("scopes");
    for (i, scope) in scopes.iter().flatten().enumerate().filter(|(_, scope)| !is_allowed(**scope)) {
        faults.enter_index(i);
        faults.add(format!(
            "the role {:?} of the member, or the key of the request, does not allow {:?}",
            role.name(),
            scope.name()
        ));
        faults.leave();
    }
    faults.leave();
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let usual = [Scope::Submit, Scope::Grade, Scope::Read];
    let scopes = scopes.unwrap_or_else(|| usual.into_iter().filter(|it| is_allowed(*it)).collect());
    let now = now_ms();
    // No key outlives the one that made it.
    let wanted = days.map(|days| now + days * DAY_MS);
    let expires_at_ms = wanted.into_iter().chain(by.expires_at_ms).min();
    let holder = Holder { owner, member: Some(member) };
    let key = match app.store.create_key(holder, &scopes, expires_at_ms, now).await? {
        KeyCreated::Key(key) => key,
        KeyCreated::NoMember => return Err(no_member(member)),
        KeyCreated::TooMany => {
            let detail = format!("the member {member:?} has {LIVE_KEYS} live keys, the maximum; revoke one first");
            return Err(AppError::conflict("too-many-keys", detail));
        }
    };
    let (id, _) = parts(&key).expect("a new key has the form of a key");
    let row = app.store.key(id).await?.ok_or_else(|| AppError::internal(&"a new key is gone"))?;
    Ok(CreatedKey { key, row })
}

/// Revokes a key of the team, given by its public part. A member may revoke keys of its own; a manager all.
///
/// # Errors
/// Returns an error if the caller may not revoke it, or if the team has no such live key.
pub async fn revoke_key(app: &App, caller: &Caller, id: &str) -> AppResult<()> {
    let caller = &app.caller_now(caller).await?;
    let owner = caller.require_owner()?;
    caller.require(Scope::Submit)?;
    let missing = || AppError::not_found("the team has no live key with this public part; GET /v1/team lists them");
    let key = app.store.key(id).await?.filter(|key| key.owner == owner && key.is_live(now_ms())).ok_or_else(missing)?;
    let is_own = caller.key.as_ref().is_some_and(|own| own.member.is_some() && own.member == key.member);
    if !is_own {
        caller.require_manager()?;
    }
    if app.store.revoke_key(id, now_ms()).await? { Ok(()) } else { Err(missing()) }
}

fn no_member(name: &str) -> AppError {
    AppError::not_found(format!("the team has no member {name:?}; GET /v1/team lists them"))
}
