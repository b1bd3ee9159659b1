//! The checkpoints of an archive: each must be of the archived log, and a witness vouches with the one that it cosigned.

use serde_json::Value;

use crate::clock::rfc3339;
use plumbline_engine::hidden::receipts::LogPage;
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::hidden::tlog::note::{Checkpoint, origin, read_verifier_key};
use plumbline_engine::hidden::tlog::tree::Tree;
use plumbline_engine::text::agreeing;

/// What an archive says of its log: only the notes are signed.
pub(super) struct ArchivedLog<'a> {
    /// `GET /log/key`.
    pub key: &'a str,
    /// `GET /log/checkpoint`.
    pub checkpoint: &'a str,
    /// `GET /log/witnesses`.
    pub witnesses: &'a Value,
    /// Tree of the receipts in the archive.
    pub tree: Tree,
    /// Name that the log has by its first receipt; `None` without one.
    pub name: Option<String>,
}

/// Position of the last receipt of the epoch, and whom the verifier trusts.
pub(super) struct Demands<'a> {
    /// Number of entries of the log that vouch for the whole epoch.
    pub size: u64,
    /// Public keys of the service, in hexadecimal.
    pub keys: &'a [&'a str],
    /// Witnesses that must have cosigned at least `size` entries.
    pub witnesses: &'a [Witness],
}

/// Returns the name of the log that the pages start with.
pub(super) fn name_of(log: &[LogPage]) -> Option<String> {
    log.iter().flat_map(|page| &page.receipts).next().map(|first| origin(&first.public_key))
}

/// Verifies the notes, and says what was found. Returns whether all of it holds.
pub(super) fn holds(archived: &ArchivedLog<'_>, demands: &Demands<'_>) -> bool {
    let mut is_good = true;
    let mut broken = |why: &str| {
        println!("BROKEN  {why}");
        is_good = false;
    };
    let told = archived.witnesses["witnesses"].as_array().map(Vec::as_slice).unwrap_or_default();
    let cosigned = told.iter().filter_map(|witness| Some(("cosigned checkpoint", witness["note"].as_str()?)));
    let mut cosigned_by: Vec<&str> = Vec::new();
    for (what, note) in [("checkpoint", archived.checkpoint)].into_iter().chain(cosigned) {
        let checkpoint = match checkpoint_in(note, archived, demands.keys) {
            Ok(checkpoint) => checkpoint,
            Err(why) => {
                broken(&format!("{what}: {why}"));
                continue;
            }
        };
        println!("{what} of {}: is of the log in the archive", agreeing(checkpoint.size, "entry", "entries"));
        if checkpoint.size < demands.size {
            println!("NOTE    {what}: is from before the epoch's last receipt, {}", demands.size);
            continue;
        }
        let lines = Checkpoint::parts(note).map(|(_, lines)| lines).unwrap_or_default();
        let has = |witness: &&Witness| lines.iter().any(|line| witness.cosigned(line, &checkpoint).is_some());
        cosigned_by.extend(demands.witnesses.iter().filter(has).map(|witness| witness.name.as_str()));
    }
    if !is_key_of(archived.key, archived.checkpoint) {
        broken("log_key: is not the key that signed the archive's checkpoint");
    }
    for why in told.iter().filter_map(untrue_of) {
        broken(&why);
    }
    for witness in demands.witnesses {
        if cosigned_by.contains(&witness.name.as_str()) {
            println!("{} has cosigned it", witness.name);
        } else {
            broken(&format!(
                "witness {}: has not cosigned the log with all receipts of the epoch; if it may have done so since, run it once more and \
                 archive again",
                witness.name
            ));
        }
    }
    if demands.witnesses.is_empty() {
        println!("NOT CHECKED  cosignatures: no witness to trust was named (--witness)");
    }
    is_good
}

/// Reads a checkpoint that a trusted key has signed and that is of the archived log; otherwise says what is wrong.
fn checkpoint_in(note: &str, archived: &ArchivedLog<'_>, keys: &[&str]) -> Result<Checkpoint, &'static str> {
    let Some(checkpoint) = Checkpoint::verified(note, keys) else {
        return Err(
            "is signed neither with the key that the epoch committed to nor with one of --key; if the operator replaced the key, \
                    the log says so: get the other one from somebody you trust, and name it with --key",
        );
    };
    let is_named = archived.name.as_ref().is_none_or(|name| *name == checkpoint.origin);
    if !is_named || archived.tree.root(checkpoint.size) != Some(checkpoint.root) {
        return Err("is not of the log in the archive");
    }
    Ok(checkpoint)
}

/// Returns whether this is the key that signed the note, under the name of its log.
fn is_key_of(key: &str, note: &str) -> bool {
    read_verifier_key(key).is_some_and(|(name, public)| {
        Checkpoint::verified(note, &[&public]).is_some_and(|checkpoint| checkpoint.origin == name)
    })
}

/// Returns what the archive says of a witness and its note contradicts. The service wrote it, and nobody signed it.
fn untrue_of(told: &Value) -> Option<String> {
    let name = told["name"].as_str().unwrap_or("without a name");
    let untrue = |what: String| Some(format!("witness {name}, as the archive tells of it: {what}"));
    let Some(witness) = told["key"].as_str().and_then(Witness::read).filter(|own| own.name == name) else {
        return untrue("key: is not a key of this witness".to_owned());
    };
    let Some(note) = told["note"].as_str() else {
        let is_silent = told["size"].is_null() && told["cosigned_at"].is_null();
        return if is_silent { None } else { untrue("note: is missing, although it has cosigned".to_owned()) };
    };
    let parts = Checkpoint::parts(note).and_then(|(text, lines)| Some((Checkpoint::read(&text)?, lines)));
    let Some((checkpoint, lines)) = parts else { return untrue("note: is no checkpoint".to_owned()) };
    let Some(at_s) = lines.iter().find_map(|line| witness.cosigned(line, &checkpoint)) else {
        return untrue("note: is not cosigned with its key".to_owned());
    };
    let at = i64::try_from(at_s).ok().and_then(|at_s| at_s.checked_mul(1_000)).map(rfc3339);
    if told["size"].as_u64() != Some(checkpoint.size) {
        return untrue(format!("size: says {}, and its note {}", told["size"], checkpoint.size));
    }
    if told["cosigned_at"].as_str() != at.as_deref() {
        return untrue(format!("cosigned_at: says {}, and its note {}", told["cosigned_at"], Value::from(at)));
    }
    None
}
