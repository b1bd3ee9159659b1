//! `plumbline webhooks`: lists and disables the webhooks of all owners.

use std::process::ExitCode;

use anyhow::bail;
use clap::{Args, Subcommand};
use comfy_table::{Table, presets};

use super::database::DatabaseArgs;
use super::process::block_on;
use crate::clock::rfc3339;
use crate::store::Store;
use crate::store::webhooks::{Enabling, WebhookChange};

/// Arguments of `webhooks`.
#[derive(Debug, Args)]
pub struct WebhooksArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: WebhooksCommand,
}

/// Commands on webhooks.
#[derive(Debug, Subcommand)]
enum WebhooksCommand {
    /// List webhooks, without their secrets, with the messages that wait or were given up and the last error.
    List,
    /// Disable a webhook; nothing more is posted to it until its owner enables it.
    Disable {
        /// Identifier of the webhook, as shown by `list`.
        id: String,
        /// Reason, which its owner sees.
        #[arg(long)]
        reason: String,
    },
}

/// Runs the command.
///
/// # Errors
/// Returns an error if the database cannot be opened, or if there is no such webhook.
pub fn run(args: &WebhooksArgs) -> anyhow::Result<ExitCode> {
    block_on(async {
        let store = args.database.open().await?;
        let done = match &args.command {
            WebhooksCommand::List => list(&store).await,
            WebhooksCommand::Disable { id, reason } => disable(&store, id, reason).await,
        };
        store.close().await;
        done
    })?;
    Ok(ExitCode::SUCCESS)
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["id", "owner", "url", "events", "created", "pending", "given up", "last error", "state"]);
    for webhook in store.webhooks().await? {
        let events = if webhook.events.is_empty() { "all".to_owned() } else { webhook.events };
        let pending = store.pending_deliveries(&webhook.id).await?.to_string();
        let given_up = store.dead_deliveries(&webhook.id).await?.to_string();
        let error = store.last_delivery_error(&webhook.id).await?.unwrap_or_default();
        let state =
            webhook.disabled_reason.map_or_else(|| "enabled".to_owned(), |reason| format!("disabled: {reason}"));
        let created = rfc3339(webhook.created_at_ms);
        table.add_row([webhook.id, webhook.owner, webhook.url, events, created, pending, given_up, error, state]);
    }
    println!("{table}");
    Ok(())
}

async fn disable(store: &Store, id: &str, reason: &str) -> anyhow::Result<()> {
    let Some(webhook) = store.webhook(id).await? else {
        bail!("there is no webhook {id:?}; plumbline webhooks list shows all");
    };
    let reason = reason.split_whitespace().collect::<Vec<_>>().join(" ");
    if reason.is_empty() {
        bail!("--reason: expected a reason, which the owner sees");
    }
    if let Some(before) = webhook.disabled_reason {
        bail!("the webhook is disabled already: {before}");
    }
    let reason = format!("disabled by the operator: {reason}");
    let change = WebhookChange { url: None, events: None, enabling: Some(Enabling::Disabled(&reason)) };
    store.change_webhook(id, &change).await?;
    println!("disabled {id} of {}", webhook.owner);
    Ok(())
}
