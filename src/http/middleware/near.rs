//! Suggests the path of an operation for one that no operation has.

use std::sync::LazyLock;

use plumbline_engine::text::nearest;

use crate::http::router::routes;

/// Longest path for which others are suggested, in bytes.
const LONGEST_PATH: usize = 200;

/// Paths of all documented operations, such as `/v1/tasks/{family}/{instance}`.
static PATHS: LazyLock<Vec<String>> = LazyLock::new(|| routes().into_openapi().paths.paths.into_keys().collect());

/// Returns a suggestion to append to an error, `; did you mean /v1/runs?`, or an empty string.
///
/// A suggested path has the same number of segments as the one that was asked for, with or without `/v1`, and keeps what
/// stands in the place of its parameters. If there is none, operations are suggested whose paths begin alike, by
/// their names: `; did you mean /v1/tasks/{family}/{instance}?`.
pub(super) fn suggestion(asked: &str) -> String {
    if asked.len() > LONGEST_PATH {
        return String::new();
    }
    let given: Vec<&str> = segments(asked).skip_while(|segment| *segment == "api").collect();
    let with_version: Vec<&str> = std::iter::once("v1").chain(given.iter().copied()).collect();
    let alike = PATHS.iter().flat_map(|path| [misspelt(path, &given), misspelt(path, &with_version)]).flatten();
    let found = alike.min().map(|(_, path)| path).or_else(|| begun(&given)).or_else(|| begun(&with_version));
    found.map_or_else(String::new, |path| format!("; did you mean {path}?"))
}

fn segments(path: &str) -> impl Iterator<Item = &str> {
    path.split('/').filter(|segment| !segment.is_empty())
}

fn is_parameter(segment: &str) -> bool {
    segment.starts_with('{')
}

fn is_near(given: &str, expected: &str) -> bool {
    nearest(given, [expected], |name| name.len() / 3).is_some()
}

/// Returns in how many segments a path differs from the one of an operation, and the latter with its parameters filled in;
/// `None` if they are too different.
fn misspelt(operation: &str, given: &[&str]) -> Option<(usize, String)> {
    let expected: Vec<&str> = segments(operation).collect();
    if expected.len() != given.len() {
        return None;
    }
    let mut misspelt = 0;
    let mut filled = String::new();
    for (expected, given) in expected.into_iter().zip(given) {
        let is_free = is_parameter(expected);
        if !is_free && !is_near(given, expected) {
            return None;
        }
        let meant = if is_free { given } else { expected };
        misspelt += usize::from(meant != *given);
        filled.push('/');
        filled.push_str(meant);
    }
    Some((misspelt, filled))
}

/// Returns the shortest path of an operation that begins as the given one does, behind `/v1`.
fn begun(given: &[&str]) -> Option<String> {
    let begins = |path: &&String| {
        let mut expected = segments(path);
        let mut is_alike =
            |given: &&str| expected.next().is_some_and(|next| is_parameter(next) || is_near(given, next));
        given.len() > 1 && given.iter().all(&mut is_alike)
    };
    PATHS.iter().filter(begins).min_by_key(|path| (segments(path).count(), path.len())).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_paths_are_mended() {
        for (asked, meant) in [
            ("/v1/submission", "/v1/submissions"),
            ("/v1/Runs", "/v1/runs"),
            ("/v1/leaderboard/mineceraft@4", "/v1/leaderboards/mineceraft@4"),
            ("/leaderboard", "/v1/leaderboards/{suite}"),
            ("/v1/submissions/", "/v1/submissions"),
            ("//v1//tasks", "/v1/tasks"),
            ("/grade", "/v1/grade"),
            ("/api/v1/grade", "/v1/grade"),
            ("/v1/submissions/abc/reports", "/v1/submissions/abc/report"),
            ("/tasks/walls/5x1x5-raise", "/v1/tasks/walls/5x1x5-raise"),
            ("/v1/tasks/113", "/v1/tasks/{family}/{instance}"),
        ] {
            assert_eq!(suggestion(asked), format!("; did you mean {meant}?"), "{asked}");
        }
    }

    #[test]
    fn other_paths_are_left() {
        for asked in ["/", "/v1", "/favicon.gif", "/wp-login.php", "/v1/x", "/.env", &"/v1/submission".repeat(99)] {
            assert_eq!(suggestion(asked), "", "{asked}");
        }
    }
}
