//! `plumbline keys`: make, list and revoke API keys.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use comfy_table::{Table, presets};

use crate::clock::{now_ms, rfc3339};
use crate::store::Store;
use crate::store::keys::{LIVE_KEYS, Scope};

/// Arguments of `keys`.
#[derive(Debug, Args)]
pub struct KeysArgs {
    /// The service's database; the service may run.
    #[arg(long, global = true, env = "PLUMBLINE_DATABASE", default_value = "plumbline.db")]
    database: PathBuf,
    #[command(subcommand)]
    command: KeysCommand,
}

/// What is done with keys.
#[derive(Debug, Subcommand)]
enum KeysCommand {
    /// Make a key and show it, this once.
    Create {
        /// Who will use it. An owner may have two live keys, to change over from one to the other.
        #[arg(long)]
        name: String,
        /// What it allows: submit, grade, read, admin.
        #[arg(long, value_delimiter = ',', default_value = "submit,grade,read")]
        scopes: Vec<String>,
        /// Days after which it ends; without this it does not.
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u16).range(1..))]
        expires: Option<u16>,
    },
    /// List keys, without their secrets.
    List,
    /// Revoke a key, by its public part. Running services follow within half a second.
    Revoke {
        /// The public part, as `list` shows it.
        id: String,
    },
}

/// Runs the command.
///
/// # Errors
/// Where the database cannot be opened; where the owner has two live keys; where there is no such key.
pub fn run(args: &KeysArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let store = Store::open(&args.database).await.with_context(|| args.database.display().to_string())?;
        let done = match &args.command {
            KeysCommand::Create { name, scopes, expires } => create(&store, name, scopes, *expires).await,
            KeysCommand::List => list(&store).await,
            KeysCommand::Revoke { id } => revoke(&store, id).await,
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn create(store: &Store, name: &str, scopes: &[String], expires: Option<u16>) -> anyhow::Result<()> {
    const DAY_MS: i64 = 86_400_000;
    if name.trim().is_empty() || name.chars().count() > 100 {
        bail!("--name: expected 1 to 100 characters");
    }
    let mut allowed = Vec::new();
    for scope in scopes {
        let Some(known) = Scope::ALL.into_iter().find(|known| known.name() == scope) else {
            bail!("--scopes: {scope:?} is none of {}", Scope::ALL.map(Scope::name).join(", "));
        };
        allowed.push(known);
    }
    let now = now_ms();
    let end = expires.map(|days| now + i64::from(days) * DAY_MS);
    let Some(key) = store.create_key(name, &allowed, end, now).await? else {
        bail!("{name:?} has {LIVE_KEYS} live keys; revoke one first (plumbline keys list)");
    };
    println!("{key}");
    eprintln!("this key is shown once; send it as Authorization: Bearer, or in PLUMBLINE_KEY for plumbline submit");
    Ok(())
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["id", "owner", "scopes", "made", "last used", "state"]);
    for key in store.keys().await? {
        let scopes: Vec<&str> = key.scopes.iter().map(|scope| scope.name()).collect();
        let state = match (key.revoked_at_ms, key.expires_at_ms) {
            (Some(at), _) => format!("revoked {}", rfc3339(at)),
            (None, Some(end)) if !key.is_live(now_ms()) => format!("expired {}", rfc3339(end)),
            (None, Some(end)) => format!("live until {}", rfc3339(end)),
            (None, None) => "live".to_owned(),
        };
        let used = key.last_used_at_ms.map_or_else(|| "never".to_owned(), rfc3339);
        table.add_row([key.id, key.owner, scopes.join(","), rfc3339(key.created_at_ms), used, state]);
    }
    println!("{table}");
    Ok(())
}

async fn revoke(store: &Store, id: &str) -> anyhow::Result<()> {
    if !store.revoke_key(id, now_ms()).await? {
        bail!("there is no key {id:?} that is not revoked");
    }
    println!("revoked {id}");
    Ok(())
}
