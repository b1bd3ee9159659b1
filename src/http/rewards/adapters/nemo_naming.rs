//! Members of a request of NeMo Gym that name the task.

use serde_json::{Map, Value};

use super::add_misspelt;
use crate::app::error::{AppError, AppResult};
use crate::app::rewards::scheme::scheme_named;
use plumbline_engine::checks::Criterion;
use plumbline_engine::hidden::canonical::canonical_json;
use plumbline_engine::intake::Faults;

/// Members that name the task, its reward scheme and the profile.
const OPTIONS: [&str; 4] = ["task", "suite", "reward_scheme", "profile"];
/// Objects below the top level in which members may stand that name the task.
const PARTS: [&str; 3] = ["verifier_metadata", "task_data", "verification_input"];

/// Members that name the task, as `/v1/grade` has them.
pub(super) struct Naming {
    pub members: Map<String, Value>,
    /// For each, its pointer there and in this request.
    pub places: Vec<(String, String)>,
}

/// A member of a request that names the task.
struct Member<'r> {
    /// Object in which it stands; empty at the top level.
    part: &'static str,
    key: &'static str,
    value: &'r Value,
}

impl Member<'_> {
    fn pointer(&self) -> String {
        let Self { part, key, .. } = self;
        if part.is_empty() { format!("/{key}") } else { format!("/{part}/{key}") }
    }
}

/// Reads the members that name the task, from the top level or from the objects below it.
///
/// # Errors
/// Returns an error (422) if an option is misspelt, or given twice with different values.
pub(super) fn naming(request: &Map<String, Value>) -> AppResult<Naming> {
    let parts: Vec<(&'static str, &Map<String, Value>)> =
        PARTS.into_iter().filter_map(|part| Some((part, request.get(part)?.as_object()?))).collect();
    let all = |key: &'static str| -> Vec<Member<'_>> {
        let places = std::iter::once(("", request)).chain(parts.iter().copied());
        let given = places.filter_map(|(part, object)| Some((part, object.get(key).filter(|value| !value.is_null())?)));
        given.map(|(part, value)| Member { part, key, value }).collect()
    };
    let missing: Vec<&str> = OPTIONS.into_iter().filter(|option| all(option).is_empty()).collect();
    let mut faults = Faults::new();
    // A dataset may have any fields of its own at the top level, so only options that nothing else is near to are checked
    // for misspellings there.
    let long: Vec<&str> = missing.iter().copied().filter(|option| option.len() > 6).collect();
    add_misspelt(request.iter().filter(|(key, _)| !is_own(key)), &long, &mut faults);
    for (key, object) in &parts {
        faults.enter_key(key);
        let has_scheme = ["reward_scheme", "scheme", "reward"].iter().any(|name| object.contains_key(*name));
        let schemes = ["scheme", "reward"].iter().filter(|_| !has_scheme && missing.contains(&"reward_scheme"));
        let names: Vec<&str> = missing.iter().chain(schemes).copied().collect();
        add_misspelt(*object, &names, &mut faults);
        faults.leave();
    }
    let mut tasks = all("task");
    let of_id = request.get("task_id").and_then(|id| id.get("task_id"));
    if let Some(value) = of_id.filter(|_| tasks.is_empty()) {
        tasks.push(Member { part: "task_id", key: "task_id", value });
    }
    // A dataset may have a member of this name for something else, which is no text.
    let profiles = all("profile").into_iter().filter(|member| member.value.is_string()).collect();
    let mut naming = Naming { members: Map::new(), places: Vec::new() };
    for (name, given) in [("task", tasks), ("suite", all("suite")), ("reward", schemes(all)), ("profile", profiles)] {
        add_conflict(&given, &mut faults);
        if let Some(first) = given.into_iter().next() {
            naming.places.push((format!("/{name}"), first.pointer()));
            naming.members.insert(name.to_owned(), first.value.clone());
        }
    }
    if faults.is_empty() { Ok(naming) } else { Err(AppError::faulty(faults)) }
}

/// Returns the reward schemes of a request. Labels for other frameworks call it `scheme`, or `reward`, which as a number
/// at the top level is the reward of an earlier response. Beside `reward_scheme` a text of that name that is no scheme is
/// the data set's own.
fn schemes<'r>(all: impl Fn(&'static str) -> Vec<Member<'r>>) -> Vec<Member<'r>> {
    let mut schemes = all("reward_scheme");
    let has_own = !schemes.is_empty();
    let is_scheme = |member: &Member<'_>| match member.value {
        Value::String(name) => !has_own || scheme_named(name).is_some(),
        value => value.get("weights").is_some(),
    };
    schemes.extend(["scheme", "reward"].into_iter().flat_map(all).filter(is_scheme));
    schemes
}

/// Returns a value as text: a text without its quotes.
fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Adds a fault if members that mean the same differ.
fn add_conflict(given: &[Member<'_>], faults: &mut Faults) {
    // A number and an id may name the same task, and a number may be written as text.
    let differ = |one: &Value, other: &Value| match (plain(one).parse::<u32>(), plain(other).parse::<u32>()) {
        (Ok(one), Ok(other)) => one != other,
        (Err(_), Err(_)) => canonical_json(one) != canonical_json(other),
        _ => false,
    };
    let Some((first, others)) = given.split_first() else { return };
    if let Some(other) = others.iter().find(|other| differ(first.value, other.value)) {
        if !other.part.is_empty() {
            faults.enter_key(other.part);
        }
        faults.add_at(other.key, format!("differs from {}, which means the same; give one", first.pointer()));
        if !other.part.is_empty() {
            faults.leave();
        }
    }
}

/// Whether a member may come from an earlier response of this service, which may be sent for verification again.
fn is_own(key: &str) -> bool {
    key == "response" || key == "responses_create_params" || is_told(key)
}

/// Whether a response of this service tells a result in this member.
pub(super) fn is_told(key: &str) -> bool {
    let component = |name: &str| name == "overall" || Criterion::ALL.iter().any(|criterion| criterion.name() == name);
    matches!(key, "reward_components" | "failure_reason" | "action_code")
        || key.strip_prefix("reward_").is_some_and(component)
}
