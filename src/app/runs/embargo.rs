//! Embargoes: a run may be anonymous until a date that is public from its beginning.

use serde::Serialize;
use serde_json::Value;

use crate::app::App;
use crate::app::access::Caller;
use crate::app::body::{DIRECTION_FAULT, changes_direction};
use crate::app::error::AppResult;
use crate::app::limits::LIMITS;
use crate::clock::{DAY_MS, day_ms, milliseconds, now_ms};
use plumbline_engine::intake::Faults;
use plumbline_engine::text::did_you_mean;

/// Embargo that a run begins with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[schema(example = json!({ "alias": "maple-7", "until": "2027-01-15" }))]
pub struct NewEmbargo {
    /// Name that the run shows for its agent. Runs of one owner may share it; the agents of other owners may not.
    #[schema(min_length = 1)]
    pub alias: String,
    /// End of the embargo: RFC 3339, or a date, which stands for the beginning of that day in UTC.
    #[serde(rename = "until")]
    #[schema(value_type = String)]
    pub until_ms: i64,
}

/// Reads an embargo, and adds all its faults.
pub fn read_embargo(value: &Value, faults: &mut Faults) -> Option<NewEmbargo> {
    let Some(members) = value.as_object() else {
        faults.add("expected an object with \"alias\" and \"until\"");
        return None;
    };
    for name in members.keys().filter(|name| !["alias", "until"].contains(&name.as_str())) {
        faults.add_at(name, format!("unknown field{}", did_you_mean(name, ["alias", "until"])));
    }
    let mut text = |name: &str| match members.get(name) {
        None | Some(Value::Null) => {
            faults.add_at(name, "missing");
            None
        }
        Some(Value::String(text)) => Some(text.clone()),
        Some(_) => {
            faults.add_at(name, "expected a string");
            None
        }
    };
    let (alias, until) = (text("alias"), text("until"));
    let alias = alias.and_then(|alias| match alias.trim() {
        trimmed if changes_direction(trimmed) => {
            faults.add_at("alias", DIRECTION_FAULT);
            None
        }
        trimmed if trimmed.contains(char::is_control) => {
            faults.add_at("alias", "control characters are not allowed");
            None
        }
        trimmed if (1..=LIMITS.agent_chars).contains(&trimmed.chars().count()) => Some(trimmed.to_owned()),
        _ => {
            faults.add_at("alias", format!("expected 1 to {} characters", LIMITS.agent_chars));
            None
        }
    });
    let until_ms = until.and_then(|text| end(&text, now_ms()).map_err(|fault| faults.add_at("until", fault)).ok());
    Some(NewEmbargo { alias: alias?, until_ms: until_ms? })
}

/// Reads the end of an embargo that begins now.
fn end(text: &str, now_ms: i64) -> Result<i64, String> {
    let end = milliseconds(text).or_else(|| day_ms(text));
    let end =
        end.ok_or_else(|| format!("{text:?} is neither an RFC 3339 time, such as 2027-01-15T00:00:00Z, nor a date"))?;
    if end <= now_ms {
        return Err(format!("{text:?} is in the past"));
    }
    if end > now_ms + LIMITS.embargo_days * DAY_MS {
        return Err(format!("{text:?} is more than {} days from now", LIMITS.embargo_days));
    }
    Ok(end)
}

/// Checks what only the stored runs tell about a new embargo, and adds its faults.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn check_embargo(
    app: &App,
    caller: &Caller,
    embargo: &NewEmbargo,
    agent: Option<&str>,
    faults: &mut Faults,
) -> AppResult<()> {
    faults.enter_key("embargo");
    match caller.owner() {
        None => faults.add("an embargo needs a key, which tells whose the run is"),
        Some(owner) if app.store.is_agent_of_others(&embargo.alias, owner).await? => {
            faults.add_at("alias", format!("{:?} is an agent of another owner; choose another alias", embargo.alias));
        }
        Some(_) if agent.is_some_and(|agent| agent.trim() == embargo.alias) => {
            faults.add_at("alias", "is the name of the agent, which the embargo would hide; choose another alias");
        }
        Some(_) => {}
    }
    faults.leave();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn every_fault_of_an_embargo_is_told() {
        let told = |value: Value| {
            let mut faults = Faults::new();
            assert_eq!(read_embargo(&value, &mut faults), None, "{value}");
            faults.list().iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(
            told(json!({ "alias": " ", "untill": "2027" })),
            ["/untill: unknown field; did you mean until?", "/until: missing", "/alias: expected 1 to 100 characters"]
        );
        assert_eq!(told(json!("2027-01-01")), ["expected an object with \"alias\" and \"until\""]);
        assert_eq!(told(json!({ "alias": "a", "until": "2020-01-01" })), ["/until: \"2020-01-01\" is in the past"]);
        assert_eq!(told(json!({ "alias": "\u{202e}a", "until": "2020-01-01" })).len(), 2);
        assert_eq!(
            told(json!({ "alias": "a", "until": "soon" })),
            ["/until: \"soon\" is neither an RFC 3339 time, such as 2027-01-15T00:00:00Z, nor a date"]
        );
        assert_eq!(
            told(json!({ "alias": 7, "until": "9999-01-01" })),
            ["/alias: expected a string", "/until: \"9999-01-01\" is more than 365 days from now"]
        );
    }
}
