//! `plumbline keys`: creates, rotates, lists and revokes API keys.

use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use comfy_table::{Table, presets};

use super::database::DatabaseArgs;
use super::process::block_on;
use crate::app::accounts::team;
use crate::app::limits::LIMITS;
use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use crate::store::keys::{Holder, KeyCreated, KeyRow, LIVE_KEYS, Role, Scope, parts};
use crate::store::members::MemberPut;
use plumbline_engine::text::agreeing;

/// Arguments of `keys`.
#[derive(Debug, Args)]
pub struct KeysArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: KeysCommand,
}

/// Commands on keys.
#[derive(Debug, Subcommand)]
enum KeysCommand {
    /// Create a key and print it; it is shown only once.
    Create {
        /// Owner of the key. An owner may have two live keys, to switch from one to the other.
        #[arg(long)]
        name: String,
        /// Member of the owner to whom the key belongs; it is added if there is no such member.
        #[arg(long)]
        member: Option<String>,
        /// Role of the member: reader, submitter or manager. A member that exists gets it too.
        #[arg(long, requires = "member")]
        role: Option<String>,
        /// Scopes of the key: submit, grade, read, admin. By default submit, grade and read, or what the role allows of
        /// them.
        #[arg(long, value_delimiter = ',')]
        scopes: Vec<String>,
        /// Lifetime in days (30, 30d) or hours (12h); without it, the key does not expire.
        #[arg(long, value_name = "TIME", value_parser = lifetime)]
        expires: Option<i64>,
    },
    /// Replace a key by a new one with the same scopes; both work for some hours, to switch over.
    Rotate {
        /// Public part of the key to replace, as shown by `list`, or the whole key.
        id: String,
        /// Hours during which both keys work.
        #[arg(long, value_name = "HOURS", default_value_t = 24, value_parser = clap::value_parser!(u32).range(0..=8_760))]
        overlap: u32,
        /// Lifetime of the new key in days (30, 30d) or hours (12h); by default, that for which the old one was made.
        #[arg(long, value_name = "TIME", value_parser = lifetime)]
        expires: Option<i64>,
    },
    /// List keys, without their secrets.
    List,
    /// Revoke a key, or all keys of an owner; running services reject them within half a second.
    Revoke {
        /// Public part of the key, as shown by `list`, or the whole key.
        #[arg(required_unless_present = "name", conflicts_with = "name")]
        id: Option<String>,
        /// Owner all of whose keys are revoked, also those of its members.
        #[arg(long)]
        name: Option<String>,
    },
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the database cannot be opened, an argument is invalid, the owner already has two live keys, or
/// there is no such key.
pub fn run(args: &KeysArgs) -> anyhow::Result<ExitCode> {
    block_on(async {
        let store = args.database.open().await?;
        let done = match &args.command {
            KeysCommand::Create { name, member, role, scopes, expires } => {
                let member = member.as_deref().map(|member| (member, role.as_deref()));
                create(&store, name, member, scopes, *expires).await
            }
            KeysCommand::List => list(&store).await,
            KeysCommand::Revoke { id: Some(id), .. } => revoke(&store, id).await,
            KeysCommand::Revoke { id: None, name } => revoke_all(&store, name.as_deref().unwrap_or_default()).await,
            KeysCommand::Rotate { id, overlap, expires } => rotate(&store, id, *overlap, *expires).await,
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn create(
    store: &Store,
    name: &str,
    member: Option<(&str, Option<&str>)>,
    scopes: &[String],
    expires: Option<i64>,
) -> anyhow::Result<()> {
    check_name("--name", name)?;
    let now = now_ms();
    let role = match member {
        Some((member, role)) => Some(role_of(store, name, member, role).await?),
        None => None,
    };
    let allowed = scopes_of(scopes, role)?;
    let end = expires.map(|lifetime_ms| now + lifetime_ms);
    let holder = Holder { owner: name, member: member.map(|(member, _)| member) };
    let too_many = || {
        format!("{:?} has {LIVE_KEYS} live keys; revoke one first (plumbline keys list)", holder.member.unwrap_or(name))
    };
    let is_live = |key: &KeyRow| key.member.as_deref() == holder.member && key.is_live(now);
    if store.keys_of(name).await?.iter().filter(|key| is_live(key)).count() as i64 >= LIVE_KEYS {
        bail!("{}", too_many());
    }
    // A role changes what the keys of the member may do, so it is stored once nothing else can be wrong.
    let before = store.members(name).await?;
    if let (Some(member), Some(role)) = (holder.member, role)
        && store.put_member(name, member, role, LIMITS.team_members, now).await? == MemberPut::Full
    {
        bail!("{name:?} has {} members, the maximum", LIMITS.team_members);
    }
    let was = before.iter().find(|known| Some(known.name.as_str()) == holder.member).map(|known| known.role);
    if let (Some(was), Some(role)) = (was, role)
        && was != role
    {
        eprintln!(
            "{:?} was a {} and is a {} now, with all keys",
            holder.member.unwrap_or_default(),
            was.name(),
            role.name()
        );
    }
    match store.create_key(holder, &allowed, end, now).await? {
        KeyCreated::Key(key) => println!("{key}"),
        KeyCreated::TooMany => bail!("{}", too_many()),
        KeyCreated::NoMember => bail!("the member was removed meanwhile"),
    }
    eprintln!("this key is shown once; send it as Authorization: Bearer, or set PLUMBLINE_KEY for plumbline submit");
    Ok(())
}

fn check_name(option: &str, name: &str) -> anyhow::Result<()> {
    team::check_name(name).map_err(|fault| anyhow::anyhow!("{option}: {fault}"))
}

/// Returns the role that a member has, or the one that it shall have.
async fn role_of(store: &Store, owner: &str, member: &str, role: Option<&str>) -> anyhow::Result<Role> {
    check_name("--member", member)?;
    if let Some(name) = role {
        let known = Role::ALL.map(Role::name).join(", ");
        return Role::named(name).with_context(|| format!("--role: {name:?} is not one of {known}"));
    }
    let known = store.members(owner).await?.into_iter().find(|known| known.name == member);
    known.map(|known| known.role).with_context(|| format!("{owner:?} has no member {member:?}; add --role to make one"))
}

/// Reads the scopes of a key; without any, those that the role allows of the usual ones.
fn scopes_of(names: &[String], role: Option<Role>) -> anyhow::Result<Vec<Scope>> {
    let is_allowed = |scope: Scope| role.is_none_or(|role| role.allows(scope));
    if names.is_empty() {
        return Ok([Scope::Submit, Scope::Grade, Scope::Read].into_iter().filter(|scope| is_allowed(*scope)).collect());
    }
    let mut scopes = Vec::new();
    for name in names {
        let Some(scope) = Scope::ALL.into_iter().find(|known| known.name() == name) else {
            bail!("--scopes: {name:?} is not one of {}", Scope::ALL.map(Scope::name).join(", "));
        };
        if !is_allowed(scope) {
            bail!("--scopes: the role of the member does not allow {name:?}");
        }
        scopes.push(scope);
    }
    Ok(scopes)
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["id", "owner", "member", "scopes", "created", "last used", "state"]);
    for key in store.keys().await? {
        let scopes: Vec<&str> = key.scopes.iter().map(|scope| scope.name()).collect();
        let state = match (key.revoked_at_ms, key.expires_at_ms) {
            (Some(at), _) => format!("revoked {}", rfc3339(at)),
            (None, Some(end)) if !key.is_live(now_ms()) => format!("expired {}", rfc3339(end)),
            (None, Some(end)) => format!("live until {}", rfc3339(end)),
            (None, None) => "live".to_owned(),
        };
        let used = key.last_used_at_ms.map_or_else(|| "never".to_owned(), rfc3339);
        let member = match (key.member, key.role) {
            (Some(member), Some(role)) => format!("{member} ({})", role.name()),
            (Some(member), None) => format!("{member} (removed)"),
            (None, _) => String::new(),
        };
        table.add_row([key.id, key.owner, member, scopes.join(","), rfc3339(key.created_at_ms), used, state]);
    }
    println!("{table}");
    Ok(())
}

/// Returns the public part of a key that may be given whole, whose secret is never printed again.
fn public_part(given: &str) -> &str {
    parts(given.trim()).map_or(given.trim(), |(id, _)| id)
}

/// Finds the live key with this public part.
async fn live_key(store: &Store, given: &str) -> anyhow::Result<KeyRow> {
    let id = public_part(given);
    // Text that does not look like a public part may be a secret, so it is not echoed.
    let is_public = id.len() <= 12 && id.chars().all(|c| c.is_ascii_hexdigit());
    let Some(key) = store.key(id).await? else {
        let shown = if is_public { format!("there is no key {id:?}") } else { "there is no such key".to_owned() };
        bail!("{shown}; plumbline keys list shows the public parts");
    };
    if !key.is_live(now_ms()) {
        bail!("the key {id} is no longer live");
    }
    Ok(key)
}

async fn revoke(store: &Store, given: &str) -> anyhow::Result<()> {
    let key = live_key(store, given).await?;
    store.revoke_key(&key.id, now_ms()).await?;
    println!("revoked {} of {}", key.id, key.owner);
    Ok(())
}

async fn revoke_all(store: &Store, owner: &str) -> anyhow::Result<()> {
    let revoked = store.revoke_keys_of(owner, now_ms()).await?;
    if revoked.is_empty() {
        bail!("{owner:?} has no live key; plumbline keys list shows all keys with their owners");
    }
    println!("revoked {} of {owner}: {}", agreeing(revoked.len(), "key", "keys"), revoked.join(", "));
    Ok(())
}

async fn rotate(store: &Store, given: &str, overlap_hours: u32, expires: Option<i64>) -> anyhow::Result<()> {
    let old = live_key(store, given).await?;
    let now = now_ms();
    let overlap_end = now + i64::from(overlap_hours) * HOUR_MS;
    let end = old.expires_at_ms.map_or(overlap_end, |own| own.min(overlap_end));
    // A key that expires is replaced by one with the same lifetime, also if its own was cut short by a replacement.
    let by_its_end = || old.expires_at_ms.map(|own| own - old.created_at_ms);
    let lifetime_ms = expires.or_else(|| old.lifetime_ms.map_or_else(by_its_end, |own| (own > 0).then_some(own)));
    let expires_at_ms = lifetime_ms.map(|lifetime_ms| now + lifetime_ms);
    let Some(key) = store.rotate_key(&old.id, end, expires_at_ms, now).await? else {
        bail!(
            "{:?} has {LIVE_KEYS} live keys beside {}; revoke one of them first (plumbline keys list)",
            old.owner,
            old.id
        );
    };
    println!("{key}");
    let until = expires_at_ms.map_or_else(String::new, |until| format!(" and works until {}", rfc3339(until)));
    if old.is_replaced() {
        eprintln!(
            "{} was replaced before; the key from then works too unless it was revoked (plumbline keys list)",
            old.id
        );
    }
    eprintln!("this key is shown only once{until}; {} of {} works until {}", old.id, old.owner, rfc3339(end));
    Ok(())
}

const HOUR_MS: i64 = 3_600_000;

/// Parses `30` or `30d` (days) or `12h` (hours) into milliseconds.
fn lifetime(text: &str) -> Result<i64, String> {
    const MAX_HOURS: i64 = 24 * 36_500;
    let (number, hours) = match text.strip_suffix('h') {
        Some(number) => (number, 1),
        None => (text.strip_suffix('d').unwrap_or(text), 24),
    };
    let count: i64 =
        number.trim().parse().map_err(|_| format!("{text:?} is neither days (30, 30d) nor hours (12h)"))?;
    let total = count.saturating_mul(hours);
    if !(1..=MAX_HOURS).contains(&total) {
        return Err(format!("{text:?} is out of range: 1h to {}d", MAX_HOURS / 24));
    }
    Ok(total * HOUR_MS)
}
