//! Texts for people: counts with their nouns, suggestions for misspelt names, and errors of serde in plain words.

use std::fmt::Display;

/// Returns the number of the line, from 1, on which a byte of a text stands.
#[must_use]
pub fn line_of(text: &str, at: usize) -> usize {
    1 + text[..at].matches('\n').count()
}

/// Begins a text with a capital letter.
#[must_use]
pub fn sentence(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

/// Returns a count with its noun: `1 fault`, `2 faults`.
#[must_use]
pub fn counted(count: impl Copy + Display, thing: &str) -> String {
    let mut text = count.to_string();
    let is_one = text == "1";
    text.reserve(thing.len() + 2);
    text.push(' ');
    text.push_str(thing);
    if !is_one {
        text.push('s');
    }
    text
}

/// Returns a count with words that agree with it: `1 block is`, `2 blocks are`.
#[must_use]
pub fn agreeing(count: impl Copy + Display, one: &str, many: &str) -> String {
    let mut text = count.to_string();
    let words = if text == "1" { one } else { many };
    text.reserve(words.len() + 1);
    text.push(' ');
    text.push_str(words);
    text
}

/// Returns how many of all do something, with words that agree: `1 of 3 blocks floats`, `none of 2 doors is blocked`.
#[must_use]
pub fn of_all(some: usize, all: impl Copy + Display, thing: &str, one: &str, many: &str) -> String {
    let all = counted(all, thing);
    match some {
        0 => format!("none of {all} {one}"),
        1 => format!("1 of {all} {one}"),
        _ => format!("{some} of {all} {many}"),
    }
}

/// Returns a range of numbers, such as `49`, `30 to 40`, `at least 3` or `at most 5`; `None` if neither end is bounded.
#[must_use]
pub fn range<N: PartialEq + Display>(least: Option<N>, most: Option<N>) -> Option<String> {
    Some(match (least, most) {
        (Some(least), Some(most)) if least == most => least.to_string(),
        (Some(least), Some(most)) => format!("{least} to {most}"),
        (Some(least), None) => format!("at least {least}"),
        (None, Some(most)) => format!("at most {most}"),
        (None, None) => return None,
    })
}

/// Returns the range of counts that a check allows. A least count of 0 says nothing, unless 0 is also the greatest one.
#[must_use]
pub fn range_of_counts(least: u32, most: Option<u32>) -> Option<String> {
    range(Some(least).filter(|least| *least > 0 || most == Some(0)), most)
}

/// Rewords an error of serde about a value for readers who know JSON but not Rust. Other errors lose at most their
/// position in the text, which means nothing for a value that was parsed before.
#[must_use]
pub fn reworded(error: &str) -> String {
    let error = error.split(" at line ").next().unwrap_or(error).trim_end();
    let mismatch = ["invalid type: ", "invalid value: "].iter().find_map(|prefix| error.strip_prefix(prefix));
    let Some((found, wanted)) = mismatch.and_then(|rest| rest.rsplit_once(", expected ")) else {
        return error.to_owned();
    };
    // The value itself is not repeated, because it may be long.
    let found = match found.split(' ').next().unwrap_or(found) {
        "map" => "object",
        "sequence" => "array",
        "floating" => "number",
        "unit" => "null",
        "newtype" | "unit variant" | "newtype variant" => "text",
        other => other,
    };
    format!("expected {}, found {found}", plain(wanted))
}

/// Returns the words of JSON for what serde expects.
fn plain(wanted: &str) -> String {
    match wanted {
        "a map" => "an object".to_owned(),
        "a sequence" => "an array".to_owned(),
        "unit" => "null".to_owned(),
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number of at least 0".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        wanted if wanted.starts_with("struct ") => "an object".to_owned(),
        wanted if wanted.starts_with("enum ") || wanted.starts_with("variant ") => "one of the known names".to_owned(),
        wanted => wanted
            .strip_prefix("an array of length ")
            .or_else(|| wanted.strip_prefix("a tuple of size "))
            .map_or_else(|| wanted.replace("a sequence", "an array"), |length| format!("an array of length {length}")),
    }
}

/// Greatest length in bytes of a name for which others are suggested: comparing takes time by both lengths.
const LONGEST_SLIP: usize = 100;

/// Returns the number of slips between two names: letters added, left out, exchanged or swapped with the next one, whatever
/// their case.
fn slips(one: &str, other: &str) -> usize {
    strsim::osa_distance(&one.to_lowercase(), &other.to_lowercase())
}

/// Returns the name with the fewest slips among those that have at most the number that `allowed` gives for them.
#[must_use]
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
    let given = given.to_lowercase();
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
#[must_use]
pub fn did_you_mean<'n>(given: &str, names: impl IntoIterator<Item = &'n str>) -> String {
    if given.len() > LONGEST_SLIP {
        return String::new();
    }
    match near(given, names, 3).as_slice() {
        [] => String::new(),
        found => format!("; did you mean {}?", found.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use serde::de::DeserializeOwned;

    use super::*;

    #[test]
    fn words_agree_with_their_counts() {
        assert_eq!([counted(0, "turn"), counted(1, "turn"), counted(2_i64, "turn")], ["0 turns", "1 turn", "2 turns"]);
        assert_eq!(agreeing(1, "block is", "blocks are"), "1 block is");
        let told = [0, 1, 2].map(|some| of_all(some, 3, "door", "is shut", "are shut"));
        assert_eq!(told, ["none of 3 doors is shut", "1 of 3 doors is shut", "2 of 3 doors are shut"]);
    }

    #[test]
    fn ranges_name_the_bounds_that_there_are() {
        let told = [(3, Some(3)), (3, Some(5)), (3, None), (0, Some(5)), (0, Some(0))];
        let told = told.map(|(least, most)| range_of_counts(least, most).unwrap());
        assert_eq!(told, ["3", "3 to 5", "at least 3", "at most 5", "0"]);
        assert_eq!(range_of_counts(0, None), None);
    }

    #[test]
    fn no_word_of_rust_reaches_the_reader() {
        fn told<T: DeserializeOwned + std::fmt::Debug>(json: &str) -> String {
            reworded(&serde_json::from_str::<T>(json).unwrap_err().to_string())
        }
        assert_eq!(told::<u32>("{}"), "expected a whole number of at least 0, found object");
        assert_eq!(told::<f64>("[]"), "expected a number, found array");
        assert_eq!(told::<i32>("1.5"), "expected a whole number, found number");
        assert_eq!(told::<u8>("-1"), "expected a whole number of at least 0, found integer");
        assert_eq!(told::<Vec<u8>>("\"a, expected b\""), "expected an array, found string");
        assert_eq!(told::<String>("null"), "expected a string, found null");
        assert_eq!(told::<[u8; 2]>("3"), "expected an array of length 2, found integer");
        assert_eq!(reworded("missing field `a` at line 1 column 2"), "missing field `a`");
    }

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
