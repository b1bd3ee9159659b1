//! `plumbline verify-draw`: checks the proof of a draw against the commitment of its epoch, before the epoch is over.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;

use super::files;
use crate::app::hidden::draws::DrawProof;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::draw_proof::{DrawMessage, verify};
use plumbline_engine::tasks::hex;

/// Arguments of `verify-draw`.
#[derive(Debug, Args)]
pub struct VerifyDrawArgs {
    /// Response to `POST /v1/entries/ID/instances`, or its member `draw` alone.
    draw: PathBuf,
    /// Epoch as published before it opened, saved from `GET /v1/epochs/NAME`.
    #[arg(long, value_name = "FILE")]
    commitment: PathBuf,
    /// Nonce that you sent. Without it, the one that the response states is taken.
    #[arg(long)]
    nonce: Option<String>,
}

/// Runs `verify-draw`, with exit code 1 if the proof does not hold.
///
/// # Errors
/// Returns an error if a file cannot be read or is something else.
pub fn run(args: &VerifyDrawArgs) -> anyhow::Result<ExitCode> {
    let (response, epoch): (Value, Value) = (files::json(&args.draw)?, files::json(&args.commitment)?);
    let draw = response.get("draw").cloned().unwrap_or(response);
    let not_a_draw = || {
        format!(
            "{}: has no proof of a draw; expected the response to POST /v1/entries/ID/instances",
            args.draw.display()
        )
    };
    let draw: DrawProof = serde_json::from_value(draw).with_context(not_a_draw)?;
    let commitment = epoch.get("commitment").cloned().unwrap_or(epoch);
    let not_an_epoch =
        || format!("{}: is no epoch; expected the response to GET /v1/epochs/NAME", args.commitment.display());
    let commitment: Commitment = serde_json::from_value(commitment).with_context(not_an_epoch)?;
    let Some(key) = &commitment.draw_key else {
        bail!("the epoch {} committed to no key of draws: its draws are checked after the reveal", commitment.epoch);
    };
    if args.nonce.as_ref().is_some_and(|nonce| *nonce != draw.nonce) {
        println!("BROKEN  nonce: the draw states {:?}", draw.nonce);
        return Ok(ExitCode::FAILURE);
    }
    if draw.epoch != commitment.epoch {
        let (file, other) = (args.draw.display(), args.commitment.display());
        bail!("{file} is a draw of the epoch {:?}, and {other} is the epoch {:?}", draw.epoch, commitment.epoch);
    }
    let message = DrawMessage { epoch: &draw.epoch, entry: &draw.entry, run: draw.run, nonce: &draw.nonce };
    let Some(output) = verify(key, &message, &draw.proof) else {
        println!("BROKEN  proof: it does not hold under the key {key}");
        return Ok(ExitCode::FAILURE);
    };
    if hex(&output) != draw.output {
        println!("BROKEN  output: the proof proves {}, the draw states {}", hex(&output), draw.output);
        return Ok(ExitCode::FAILURE);
    }
    println!(
        "what run {} of entry {} draws with is as epoch {} committed to: neither side chose it. Which instances that gives is checked \
         after the reveal",
        draw.run, draw.entry, draw.epoch
    );
    Ok(ExitCode::SUCCESS)
}
