//! The bodies that register an entry and draw the instances of a run.

use crate::app::body::values::Parsed;
use crate::app::body::{agent_name, name, request_body};
use crate::app::limits::LIMITS;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::feedback::Tier;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{Integer, Text};
use plumbline_engine::text::did_you_mean;

request_body! {
    /// Request to register an entry.
    #[schema(example = json!({ "agent": "my-agent 1.2", "tier": "official", "runs": 2,
                               "configuration_sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08" }))]
    pub struct NewEntryBody: "an object with \"agent\", \"configuration_sha256\", \"tier\" and \"runs\"" {
        /// Name of the evaluated agent, as shown on boards.
        #[schema(value_type = String, min_length = 1)]
        agent: String = required(agent_name),
        /// SHA-256 of everything that determines the agent: weights, prompts, sampling. Keep the hashed data.
        #[schema(value_type = String, pattern = "^[0-9a-f]{64}$")]
        configuration_sha256: String = required(sha256),
        /// `dev` or `official`. The open tier, with full feedback, is the public suite: use `POST /v1/runs`.
        #[schema(value_type = Tier)]
        tier: Tier = required(|faults| Parsed { text: name(faults), parse: tier_named }),
        /// Number of runs; each has its own draw.
        #[schema(value_type = u32, minimum = 1)]
        runs: i64 = required(|faults| Integer { faults, min: 1, max: LIMITS.entry_runs.into() }),
    }
    unknown: |_| "unknown field; an entry has agent, configuration_sha256, tier and runs"
}

fn sha256(faults: &mut Faults) -> Parsed<'_, String> {
    let parse = |text: &str| {
        let has_upper = text.bytes().any(|byte| byte.is_ascii_uppercase());
        let is_hash = !has_upper && unhex::<32>(text).is_some();
        is_hash.then(|| text.to_owned()).ok_or_else(|| "expected 64 lower-case hexadecimal digits".to_owned())
    };
    Parsed { text: Text { faults, min_chars: 0, max_chars: usize::MAX }, parse }
}

/// Finds the tier with this name in the API.
fn tier_named(name: &str) -> Result<Tier, String> {
    let known = Tier::ALL.map(Tier::name);
    Tier::ALL
        .into_iter()
        .find(|tier| tier.name() == name)
        .ok_or_else(|| format!("{name:?} is not one of {}{}", known.join(", "), did_you_mean(name, known)))
}

request_body! {
    /// Request to draw the instances of a run.
    #[schema(as = NewDraw, example = json!({ "run": 1, "nonce": "8c1f0d3e5b7a4f6d9e2c" }))]
    pub struct NewDrawBody: "an object with \"run\" and \"nonce\"" {
        /// Number of the run within the entry, from 1.
        // Only the entry knows how many runs there are.
        #[schema(value_type = u32, minimum = 1)]
        run: i64 = required(|faults| Integer { faults, min: i64::MIN, max: i64::MAX }),
        /// Random characters chosen by the client. The draw depends on the nonce and on the epoch's key, so neither
        /// side alone can control it.
        #[schema(value_type = String)]
        nonce: String = required(nonce),
    }
    unknown: |_| "unknown field; a draw has run and nonce"
}

request_body! {
    /// Request that brings the round of a beacon, as its servers publish it.
    #[schema(as = NewRound, example = json!({ "round": 123, "signature": "b75c69d0b72a5d906e854e808ba7e2accb1542ac355ae486d591aa9d43765482e26cd02df835d3546d23c4b13e0dfc92" }))]
    pub struct NewRoundBody: "an object with \"round\" and \"signature\"" {
        /// Number of the round, which is in the commitment.
        #[schema(value_type = u64, minimum = 1)]
        round: i64 = required(|faults| Integer { faults, min: 1, max: i64::MAX }),
        /// Signature of the chain, in hex.
        #[schema(value_type = String, pattern = "^[0-9a-fA-F]{96}$")]
        signature: String = required(|faults| Parsed { text: Text { faults, min_chars: 0, max_chars: usize::MAX }, parse: round_signature }),
        /// Follows from the signature.
        #[schema(value_type = Option<String>)]
        randomness: String = optional(|faults| Text { faults, min_chars: 0, max_chars: usize::MAX }),
        /// Of chains whose rounds sign the one before; empty or null.
        #[schema(value_type = Option<String>)]
        previous_signature: String = optional(|faults| Text { faults, min_chars: 0, max_chars: usize::MAX }),
    }
    unknown: |_| "unknown field; a round has round and signature"
}

fn round_signature(text: &str) -> Result<String, String> {
    let is_signature = text.len() == 96 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_signature.then(|| text.to_owned()).ok_or_else(|| "expected 96 hexadecimal digits".to_owned())
}

const fn nonce(faults: &mut Faults) -> Text<'_> {
    Text { faults, min_chars: LIMITS.nonce_min_chars, max_chars: LIMITS.nonce_max_chars }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::body::{Body, read_body};

    fn faults_of<B: Body>(text: &str) -> Vec<String> {
        let mut faults = Faults::new();
        read_body::<B>(text.as_bytes(), &mut faults).unwrap();
        faults.list().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn every_fault_of_an_entry_is_told() {
        let told = faults_of::<NewEntryBody>(
            r#"{"agent": " ", "configuration_sha256": "ABC", "tier": "oficial", "runs": 17, "run": 1}"#,
        );
        assert_eq!(
            told,
            [
                "/agent: expected a name that does not only consist of spaces",
                "/configuration_sha256: expected 64 lower-case hexadecimal digits",
                "/tier: \"oficial\" is not one of dev, official; did you mean official?",
                "/runs: 17 is out of range: 1 to 16",
                "/run: unknown field; an entry has agent, configuration_sha256, tier and runs",
            ]
        );
        let missing = ["/agent: missing", "/configuration_sha256: missing", "/tier: missing", "/runs: missing"];
        assert_eq!(faults_of::<NewEntryBody>("{}"), missing);
    }

    #[test]
    fn every_fault_of_a_draw_is_told() {
        assert_eq!(
            faults_of::<NewDrawBody>(r#"{"run": "1", "nonce": "short"}"#),
            ["/run: expected an integer, found \"1\"", "/nonce: expected 16 to 128 characters, found 5"]
        );
    }
}
