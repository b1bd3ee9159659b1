//! Reading the body that creates a run, with all faults at once.

use serde::de::{IgnoredAny, MapAccess};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{OrNull, Read, Shape, Text};

/// Body that creates a run.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "agent": "my-agent 1.2", "suite": "mineceraft", "metadata": { "model": "m-7b" } }))]
#[expect(dead_code, reason = "describes the body that NewRunShape reads")]
pub struct NewRunBody {
    /// Name of the agent, as the board shows it.
    #[schema(min_length = 1, max_length = 100)]
    agent: String,
    /// Suite: name, or name@version.
    #[schema(min_length = 1, max_length = 100)]
    suite: String,
    /// Other information worth keeping, as an object.
    #[schema(value_type = Option<Object>)]
    metadata: Option<Value>,
    /// Origin of its logs; `self-reported` by default. `re-run-by-host` needs the scope `admin`.
    provenance: Option<RunProvenance>,
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
}

/// A run to create, as far as its body could be read.
#[derive(Debug)]
pub struct ParsedRun {
    /// Name of the agent.
    pub agent: Option<String>,
    /// Suite: name, or name@version.
    pub suite: Option<String>,
    /// Metadata from its owner; an empty object if there is none.
    pub metadata: Value,
    /// Origin of its logs.
    pub provenance: Option<RunProvenance>,
}

/// Shape of the body that creates a run.
#[derive(Debug)]
pub struct NewRunShape<'f> {
    /// List that receives the faults.
    pub faults: &'f mut Faults,
}

impl<'de> Shape<'de> for NewRunShape<'_> {
    type Out = ParsedRun;

    fn wanted(&self) -> &'static str {
        "an object with \"agent\" and \"suite\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<ParsedRun>, A::Error> {
        let faults = self.faults;
        let (mut agent, mut suite, mut metadata, mut provenance) = (None, None, None, None);
        while let Some(key) = members.next_key::<String>()? {
            faults.enter_key(&key);
            match key.as_str() {
                "agent" if agent.is_none() => {
                    let text = Text { faults, min_chars: 1, max_chars: LIMITS.agent_chars };
                    let name = members.next_value_seed(Read(text))?;
                    if name.as_ref().is_some_and(|name| name.trim().is_empty() && !name.is_empty()) {
                        faults.add("expected a name that does not only consist of spaces");
                    }
                    agent = Some(name);
                }
                "suite" if suite.is_none() => {
                    suite = Some(members.next_value_seed(Read(Text { faults, min_chars: 1, max_chars: 100 }))?);
                }
                "metadata" if metadata.is_none() => {
                    let value: Value = members.next_value()?;
                    if !value.is_object() && !value.is_null() {
                        faults.add("expected an object");
                    } else if value.to_string().len() > LIMITS.metadata_bytes {
                        faults.add(format!("larger than {} bytes", LIMITS.metadata_bytes));
                    }
                    metadata = Some(value);
                }
                "provenance" if provenance.is_none() => {
                    let text = Text { faults, min_chars: 1, max_chars: 100 };
                    let named: Option<String> = members.next_value_seed(Read(OrNull(text)))?.flatten().flatten();
                    let known = |named: &String| RunProvenance::ALL.into_iter().find(|known| known.name() == named);
                    let found = named.as_ref().and_then(known);
                    if named.is_some() && found.is_none() {
                        faults
                            .add(format!("expected one of {}", RunProvenance::ALL.map(RunProvenance::name).join(", ")));
                    }
                    provenance = Some(found);
                }
                "agent" | "suite" | "metadata" | "provenance" => {
                    faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    faults.add("unknown field; a run has agent, suite, metadata and provenance");
                    members.next_value::<IgnoredAny>()?;
                }
            }
            faults.leave();
        }
        for (key, is_missing) in [("agent", agent.is_none()), ("suite", suite.is_none())] {
            if is_missing {
                faults.add_at(key, "missing");
            }
        }
        let metadata = metadata.filter(|value| !value.is_null()).unwrap_or_else(|| serde_json::json!({}));
        let provenance = provenance.flatten();
        Ok(Some(ParsedRun { agent: agent.flatten(), suite: suite.flatten(), metadata, provenance }))
    }
}
