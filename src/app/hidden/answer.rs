//! Parser of answers to hidden instances, which reports all faults at once.

use crate::app::body::values::Parsed;
use crate::app::body::{profile, read_body, request_body};
use crate::app::submissions::log_member::{stored_log, turns};
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::schema::{NewTurn, StoredLogBody};
use plumbline_engine::intake::tolerant::Text;
use plumbline_engine::voxel::Profile;

request_body! {
    /// The answer to a hidden instance.
    #[schema(example = json!({ "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }],
                               "transcript_sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08" }))]
    pub struct NewAnswerBody: "an object with \"turns\"" {
        /// Actions of each turn, in any form that a submission accepts. Either `turns` or `log` is required.
        #[schema(value_type = Option<Vec<NewTurn>>)]
        turns: SentLog = work(turns),
        /// The log in its stored form, as `/v1/submissions/{id}/log` returns it.
        #[schema(value_type = Option<StoredLogBody>)]
        log: SentLog = work(stored_log),
        /// Rules under which the actions become a build. By default those of the epoch for action code, and `published`
        /// for plain events.
        profile: Profile = optional(profile),
        /// SHA-256 of the agent's transcript, which must be shown on request.
        #[schema(pattern = "^[0-9a-fA-F]{64}$")]
        transcript_sha256: String = optional(hash),
    }
    unknown: |_| "unknown field; an answer has turns or log, profile and transcript_sha256"
}

/// An answer as posted.
#[derive(Debug)]
pub struct PostedAnswer {
    /// Log, with action code that is yet to be run.
    pub sent: SentLog,
    /// Rules that were asked for.
    pub profile: Option<Profile>,
    /// SHA-256 of the transcript that the entrant promises to show, in hex.
    pub transcript_sha256: Option<String>,
}

/// Reads an answer and adds all its faults to `faults`. Returns `None` if it has no log that could be read.
///
/// # Errors
/// Returns an error if the text is not JSON.
pub fn read_answer(text: &[u8], faults: &mut Faults) -> Result<Option<PostedAnswer>, serde_json::Error> {
    let posted = |NewAnswerBody { turns, log, profile, transcript_sha256 }| {
        Some(PostedAnswer { sent: turns.or(log)?, profile, transcript_sha256 })
    };
    Ok(read_body(text, faults)?.and_then(posted))
}

/// The shape of a SHA-256 in hex.
pub fn hash(faults: &mut Faults) -> Parsed<'_, String> {
    let parse = |hash: &str| match unhex::<32>(hash) {
        Some(_) => Ok(hash.to_lowercase()),
        None => Err("expected 64 hexadecimal digits".to_owned()),
    };
    Parsed { text: Text { faults, min_chars: 0, max_chars: 1_000 }, parse }
}
