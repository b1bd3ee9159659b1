//! Reads query strings and reports a fault for each invalid parameter.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;

use crate::app::error::{AppError, AppResult, FaultBody};
use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::text::{did_you_mean, reworded};

/// Extractor for the parameters of a query string.
#[derive(Debug, Clone, Copy, Default)]
pub struct Params<T>(pub T);

impl<S: Sync, T: DeserializeOwned> FromRequestParts<S> for Params<T> {
    type Rejection = AppError;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> AppResult<Self> {
        read(parts.uri.query().unwrap_or_default()).map(Self)
    }
}

/// Extractor for parameters that are all optional: those that could be read, and the faults of the others, to which the
/// use case adds its own.
#[derive(Debug, Clone, Default)]
pub struct SoundParams<T>(pub T, pub Vec<FaultBody>);

impl<S: Sync, T: DeserializeOwned> FromRequestParts<S> for SoundParams<T> {
    type Rejection = AppError;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> AppResult<Self> {
        read_sound(parts.uri.query().unwrap_or_default())
    }
}

/// Reads a position `x,y,z`, the value of a parameter.
///
/// # Errors
/// Returns an error (400) if it is not a valid value.
pub fn position(name: &str, text: &str) -> AppResult<[i32; 3]> {
    let parts: Result<Vec<i32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let position = parts.ok().and_then(|parts| <[i32; 3]>::try_from(parts).ok());
    position.ok_or_else(|| AppError::wrong_parameter(name, "expected three integers with commas, such as 0,0,0"))
}

/// Reads the parameters of a query string that are sound, and the faults of the others.
///
/// # Errors
/// Returns an error (400) if a parameter is missing or repeated.
fn read_sound<T: DeserializeOwned>(query: &str) -> AppResult<SoundParams<T>> {
    if let Ok(value) = serde_urlencoded::from_str(query) {
        return Ok(SoundParams(value, Vec::new()));
    }
    let (faults, sound) = apart::<T>(query);
    match serde_urlencoded::from_str(&sound) {
        Ok(value) if !faults.is_empty() => Ok(SoundParams(value, faults)),
        _ => Err(read::<T>(query).err().unwrap_or_else(|| AppError::invalid_query(faults))),
    }
}

/// Reads the parameters of a query string.
///
/// # Errors
/// Returns an error (400) with all faults if a parameter is invalid.
pub fn read<T: DeserializeOwned>(query: &str) -> AppResult<T> {
    let whole = match serde_urlencoded::from_str(query) {
        Ok(value) => return Ok(value),
        Err(error) => error.to_string(),
    };
    let (mut faults, _) = apart::<T>(query);
    if faults.is_empty() {
        let name = whole.split('`').nth(1).unwrap_or_default().to_owned();
        faults.push(fault(&name, "", &whole));
    }
    Err(AppError::invalid_query(faults))
}

/// Tells the faulty parameters of a query string from the sound ones, and returns the faults of the former and a query
/// string of the latter. Reads each parameter alone; missing and repeated parameters show only in the whole query.
fn apart<T: DeserializeOwned>(query: &str) -> (Vec<FaultBody>, String) {
    let mut faults = Vec::new();
    let mut sound = form_urlencoded::Serializer::new(String::new());
    for (name, value) in form_urlencoded::parse(query.as_bytes()).take(LIMITS.query_parameters) {
        let alone = form_urlencoded::Serializer::new(String::new()).append_pair(&name, &value).finish();
        match serde_urlencoded::from_str::<T>(&alone).map_err(|error| error.to_string()) {
            Err(detail) if !detail.starts_with("missing field") => {
                if faults.len() < Faults::KEPT {
                    faults.push(fault(&name, &value, &detail));
                }
            }
            _ => {
                sound.append_pair(&name, &value);
            }
        }
    }
    (faults, sound.finish())
}

fn fault(name: &str, value: &str, detail: &str) -> FaultBody {
    let names = |text: &str| text.split('`').skip(3).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let shown: String = value.chars().take(100).collect();
    let detail = if detail.starts_with("unknown field") {
        let known = names(detail);
        let near = did_you_mean(name, known.iter().map(String::as_str));
        let stop = if near.is_empty() { "." } else { "" };
        format!("there is no such parameter{near}{stop} The parameters are {}", known.join(", "))
    } else if detail.starts_with("unknown variant") {
        let known = names(detail);
        format!("{shown:?} is not one of {}{}", known.join(", "), did_you_mean(value, known.iter().map(String::as_str)))
    } else if detail.starts_with("invalid digit")
        || detail.starts_with("number too large")
        || detail.starts_with("cannot parse integer")
    {
        format!("{shown:?} is not a whole number in range")
    } else if detail.starts_with("provided string was not") {
        format!("{shown:?} is neither true nor false")
    } else {
        reworded(detail)
    };
    let name: String = name.chars().take(100).collect();
    FaultBody::of_parameter(name, detail)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Order {
        Ascending,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only read")]
    struct Wanted {
        run: String,
        limit: Option<u32>,
        order: Option<Order>,
    }

    #[test]
    fn every_parameter_that_is_wrong_is_named() {
        let faults = |query: &str| {
            let problem = crate::http::problem::Problem::from(read::<Wanted>(query).unwrap_err());
            problem
                .faults
                .into_iter()
                .map(|fault| format!("{}: {}", fault.parameter.unwrap(), fault.detail))
                .collect::<Vec<_>>()
        };
        assert!(read::<Wanted>("run=1&limit=3&order=ascending").is_ok());
        assert_eq!(
            faults("run=1&limit=x&order=ascendin&limits=2"),
            [
                "limit: \"x\" is not a whole number in range",
                "order: \"ascendin\" is not one of ascending; did you mean ascending?",
                "limits: there is no such parameter; did you mean limit? The parameters are run, limit, order",
            ]
        );
        assert_eq!(faults("limit=1"), ["run: missing field `run`"]);
        assert_eq!(faults("run=1&run=2"), ["run: duplicate field `run`"]);
    }

    #[test]
    fn sound_parameters_are_read_beside_faulty_ones() {
        #[derive(Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Optional {
            since: Option<String>,
            limit: Option<u32>,
        }

        let SoundParams(Optional { since, limit }, faults) = read_sound("since=once&limit=x&limits=2").unwrap();
        let named: Vec<_> = faults.iter().filter_map(|fault| fault.parameter.as_deref()).collect();
        assert_eq!((since.as_deref(), limit, named), (Some("once"), None, vec!["limit", "limits"]));
        assert!(read_sound::<Optional>("since=once&since=twice").is_err());
    }
}
