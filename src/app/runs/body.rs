//! The body that creates a run.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::app::body::values::{Json, Parsed};
use crate::app::body::{name, request_body};
use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::Text;

request_body! {
    /// Body that creates a run.
    #[schema(example = json!({ "agent": "my-agent 1.2", "suite": "mineceraft", "metadata": { "model": "m-7b" } }))]
    pub struct NewRunBody: "an object with \"agent\" and \"suite\"" {
        /// Name of the agent, as the board shows it.
        #[schema(value_type = String, min_length = 1)]
        agent: String = required(agent_name),
        /// Suite: name, or name@version.
        #[schema(value_type = String, min_length = 1)]
        suite: String = required(name),
        /// Other information worth keeping, as an object.
        #[schema(value_type = Option<Object>)]
        metadata: Value = optional(|faults| Json { faults, read: read_metadata }),
        /// Origin of its logs; `self-reported` by default. `re-run-by-host` needs the scope `admin`.
        provenance: RunProvenance = optional(|faults| Parsed { text: name(faults), parse: RunProvenance::named }),
    }
    unknown: |_| "unknown field; a run has agent, suite, metadata and provenance"
}

fn agent_name(faults: &mut Faults) -> Parsed<'_, String> {
    let parse = |name: &str| match name.trim() {
        "" => Err("expected a name that does not only consist of spaces".to_owned()),
        _ => Ok(name.to_owned()),
    };
    Parsed { text: Text { faults, min_chars: 1, max_chars: LIMITS.agent_chars }, parse }
}

fn read_metadata(value: &Value, faults: &mut Faults) -> Option<Value> {
    if !value.is_object() {
        faults.add("expected an object");
    } else if value.to_string().len() > LIMITS.metadata_bytes {
        faults.add(format!("larger than {} bytes", LIMITS.metadata_bytes));
    } else {
        return Some(value.clone());
    }
    None
}

/// Origin of the logs of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RunProvenance {
    /// The owner of the run reports them.
    SelfReported,
    /// The operator of the service re-ran the agent.
    ReRunByHost,
}

impl RunProvenance {
    /// All variants.
    pub const ALL: [Self; 2] = [Self::SelfReported, Self::ReRunByHost];

    /// Returns the name in the API.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SelfReported => "self-reported",
            Self::ReRunByHost => "re-run-by-host",
        }
    }
    /// Finds the origin with this name in the API.
    fn named(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|known| known.name() == name);
        found.ok_or_else(|| format!("expected one of {}", Self::ALL.map(Self::name).join(", ")))
    }
}
