//! `plumbline verify-draw`: checks the proof and the receipt of a draw against the commitment of its epoch, before the
//! epoch is over.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;

use super::evidence::{drawn_otherwise, key, read_given};
use super::files;
use crate::app::hidden::draws::DrawProof;
use plumbline_engine::hidden::FIRST_WITH_PROMPTS;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::draw_proof::{DrawMessage, verify};
use plumbline_engine::hidden::evidence::{Fact, fact};
use plumbline_engine::hidden::receipts::verify_signature;
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
    /// Additional public key of receipts to trust, in hex, besides the one that the epoch committed to; needed if the key
    /// changed.
    #[arg(long = "key", value_name = "HEX", value_parser = key)]
    keys: Vec<String>,
}

/// Runs `verify-draw`, with exit code 1 if the proof does not hold.
///
/// # Errors
/// Returns an error if a file cannot be read or is something else.
pub fn run(args: &VerifyDrawArgs) -> anyhow::Result<ExitCode> {
    let (response, epoch): (Value, Value) = (files::json(&args.draw)?, files::json(&args.commitment)?);
    let draw = response.get("draw").unwrap_or(&response).clone();
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
    let Some(draw_key) = &commitment.draw_key else {
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
    let Some(output) = verify(draw_key, &message, &draw.proof) else {
        println!("BROKEN  proof: it does not hold under the key {draw_key}");
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
    let receipt_key = commitment.rules.as_ref().map(|rules| rules.receipt_key.as_str());
    let trusted: Vec<&str> = args.keys.iter().map(String::as_str).chain(receipt_key).collect();
    Ok(match receipt_of(&response, &draw, &commitment, &trusted) {
        Receipt::Holds => {
            println!(
                "its receipt states these instances and prompts: keep this file, and give it to verify-epoch (--given)"
            );
            ExitCode::SUCCESS
        }
        Receipt::NotChecked(why) => {
            println!("NOT CHECKED  receipt: {why}");
            ExitCode::SUCCESS
        }
        Receipt::Broken(why) => {
            println!("BROKEN  receipt: {why}");
            ExitCode::FAILURE
        }
    })
}

/// What the receipt of a draw is worth.
enum Receipt {
    /// It is signed, and states what the response says.
    Holds,
    /// It cannot be compared, for this reason.
    NotChecked(String),
    /// It is not what it should be, for this reason.
    Broken(String),
}

/// Compares the response to a draw with the receipt in it.
fn receipt_of(response: &Value, draw: &DrawProof, commitment: &Commitment, trusted: &[&str]) -> Receipt {
    let is_whole = response.get("instances").is_some();
    let Some(receipt) = response.get("receipt").filter(|receipt| !receipt.is_null()) else {
        if is_whole && commitment.protocol() >= FIRST_WITH_PROMPTS {
            return Receipt::Broken("the response has none, and the protocol of the epoch demands one".to_owned());
        }
        let why =
            "there is none in the file; save the whole response, which has one since plumbline signs draws at once";
        return Receipt::NotChecked(why.to_owned());
    };
    let Some(given) = read_given(receipt) else { return Receipt::Broken("it is no receipt".to_owned()) };
    if verify_signature(&given.receipt, &given.public_key, &given.signature).is_err() {
        return Receipt::Broken("its signature does not hold".to_owned());
    }
    if !trusted.contains(&given.public_key.as_str()) {
        let key = &given.public_key;
        return Receipt::Broken(format!(
            "it is signed with {key}, which the epoch did not commit to; if the log says that the operator replaced the key, get the \
             new one from somebody you trust, and name it with --key"
        ));
    }
    let Some(Fact::Draw(stated)) = fact(&given.receipt) else {
        return Receipt::Broken("it states something else than a draw".to_owned());
    };
    let of = (&stated.entry, stated.run, &stated.nonce, stated.proof.as_ref());
    if given.receipt["epoch"] != draw.epoch || of != (&draw.entry, draw.run, &draw.nonce, Some(&draw.proof)) {
        return Receipt::Broken("it is of another draw".to_owned());
    }
    if let Some(why) = drawn_otherwise(response, &stated, commitment) {
        return Receipt::Broken(why);
    }
    if stated.prompts_sha256.is_empty() {
        return Receipt::NotChecked(
            "it states the instances, but not what was asked, which the epoch's protocol did not demand".to_owned(),
        );
    }
    let has_prompts = |own: &Value| own["prompts"].is_array();
    if !response["instances"].as_array().is_some_and(|all| all.iter().all(has_prompts)) {
        return Receipt::NotChecked("it states these instances, but the file lacks the prompts of some".to_owned());
    }
    Receipt::Holds
}
