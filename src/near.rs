//! Texts for people: suggestions for misspelt names, and counts with their nouns.

pub use plumbline_engine::text::{agreeing, counted, reworded};

/// Returns the number of slips between two names: letters added, left out, exchanged or swapped with the next one, whatever
/// their case.
fn slips(one: &str, other: &str) -> usize {
    strsim::osa_distance(&one.to_lowercase(), &other.to_lowercase())
}

/// Returns the name with the fewest slips among those that have at most the number that `allowed` gives for them.
pub fn nearest<'n>(
    given: &str,
    names: impl IntoIterator<Item = &'n str>,
    allowed: impl Fn(&str) -> usize,
) -> Option<&'n str> {
    let counted = names.into_iter().map(|name| (slips(given, name), name));
    counted.filter(|(slips, name)| *slips <= allowed(name)).min().map(|(_, name)| name)
}

/// Returns at most `most` names that are near to `given`, the nearest first.
fn near<'n>(given: &str, names: impl IntoIterator<Item = &'n str>, most: usize) -> Vec<&'n str> {
    let given: String = given.to_lowercase().chars().take(100).collect();
    let allowed = 1 + given.chars().count() / 3;
    let mut found: Vec<(usize, &str)> = names
        .into_iter()
        .filter_map(|name| {
            let distance = slips(&given, name);
            let begins = given.chars().count() >= 3 && name.to_lowercase().starts_with(&given);
            (distance <= allowed || begins).then_some((distance, name))
        })
        .collect();
    found.sort_unstable();
    found.dedup();
    found.truncate(most);
    found.into_iter().map(|(_, name)| name).collect()
}

/// Returns near names as a suggestion to append to a fault, `; did you mean a, b?`, or an empty string.
pub fn did_you_mean<'n>(given: &str, names: impl IntoIterator<Item = &'n str>) -> String {
    match near(given, names, 3).as_slice() {
        [] => String::new(),
        found => format!("; did you mean {}?", found.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_found_and_far_ones_not() {
        let names = ["reward_scheme", "task", "suite"];
        assert_eq!(near("reward_schem", names, 1), ["reward_scheme"]);
        assert_eq!(near("tsak", names, 1), ["task"]);
        assert_eq!(near("Suites", names, 1), ["suite"]);
        assert_eq!(near("reward", names, 1), ["reward_scheme"]);
        assert!(near("image", names, 1).is_empty());
        assert_eq!(did_you_mean("wals", ["walls", "halls", "roofs"]), "; did you mean walls, halls?");
        assert_eq!(did_you_mean("nothing", names), "");
    }

    #[test]
    fn the_nearest_name_is_within_what_it_allows() {
        let names = ["task", "tasks", "suite"];
        assert_eq!(nearest("TAKS", names, |_| 1), Some("task"));
        assert_eq!(nearest("taskss", names, |_| 1), Some("tasks"));
        assert_eq!(nearest("sweet", names, |name| name.len() / 3), None);
        assert_eq!(nearest("sweet", names, |_| 3), Some("suite"));
    }
}
