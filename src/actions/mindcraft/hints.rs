//! Hints for the author of code that built nothing: what was never called, and what is not there.

use std::collections::HashSet;

use crate::actions::CodeError;

/// Number of functions that a hint names.
const MAX_NAMED: usize = 3;
/// Most bytes of the parameters of a function that a hint names. Without a bound, text without brackets that close would be
/// read to its end for each name.
const MAX_PARAMETERS: usize = 500;

/// Note on code that ended and built nothing.
const IDLE: &str = "the code ended without placing or removing a block";

/// Says that code ended and built nothing, and names what it defines and never calls.
pub fn idle(code: &str) -> String {
    let unused = never_called(code);
    if let Some(first) = unused.last() {
        return format!(
            "{IDLE}: it defines {}, which nothing calls; end it with `await {first}(bot);`",
            unused.join(", ")
        );
    }
    let is_exported = code.lines().any(is_export);
    let exported = ": of what it exports, a function alone, `main` or `default` is called, and it has none of these";
    format!("{IDLE}{}", if is_exported { exported } else { "" })
}

/// Says that a function is called with the bot alone, if code fails because it expects more.
pub fn second_parameter(code: &str, errors: &[CodeError]) -> Option<String> {
    let is_missing = errors.iter().any(|error| error.message.contains("of undefined"));
    let (_, rest) = code.split_once("(bot,")?;
    let (name, _) = rest.split_once([',', ')'])?;
    let name = name.trim();
    let is_given = ["skills", "world", "Vec3", "mc", "log"].contains(&name);
    (is_missing && is_given).then(|| {
        format!("a function is called with bot alone, so its parameter {name} is undefined: leave it out, {name} is there without it")
    })
}

/// Returns whether a line exports something.
fn is_export(line: &str) -> bool {
    let line = line.trim_start();
    ["export ", "exports", "module.exports"].iter().any(|word| line.starts_with(word))
}

/// Returns the names of functions that code defines and mentions nowhere else but where it exports them.
fn never_called(code: &str) -> Vec<&str> {
    let mut mentioned: HashSet<&str> = HashSet::new();
    let mut defined: Vec<&str> = Vec::new();
    let mut begin = 0;
    for line in code.split_inclusive('\n') {
        let mut before = "";
        for (at, word) in words_of(line) {
            let after = code[begin + at + word.len()..].trim_start();
            let is_function = match before {
                "function" => after.starts_with('('),
                "const" | "let" | "var" => is_made_a_function(after),
                _ => false,
            };
            if is_function {
                defined.push(word);
            } else if !is_export(line) {
                mentioned.insert(word);
            }
            before = word;
        }
        begin += line.len();
    }
    defined.retain(|name| !mentioned.contains(name));
    defined.truncate(MAX_NAMED);
    defined
}

/// Returns whether what follows a name makes it a function.
fn is_made_a_function(after: &str) -> bool {
    let Some(value) = after.strip_prefix('=').map(str::trim_start) else { return false };
    let value = value.strip_prefix("async").map_or(value, str::trim_start);
    let near = &value[..value.floor_char_boundary(MAX_PARAMETERS)];
    let end = near.strip_prefix('(').and_then(|rest| rest.find(')')).map(|end| end + 2);
    value.starts_with("function") || end.is_some_and(|end| value[end..].trim_start().starts_with("=>"))
}

/// Returns the words of a line with their places, in bytes.
fn words_of(line: &str) -> impl Iterator<Item = (usize, &str)> {
    let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == '$';
    let pieces = line.split_inclusive(move |c| !is_part(c)).scan(0, |end, piece| {
        let at = *end;
        *end += piece.len();
        Some((at, piece))
    });
    pieces.map(move |(at, piece)| (at, piece.trim_end_matches(|c| !is_part(c)))).filter(|(_, word)| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_that_nothing_calls_are_named() {
        for (code, told) in [
            (
                "const build = async (bot) => { f(); };",
                "it defines build, which nothing calls; end it with `await build(bot);`",
            ),
            (
                "async function row(bot, y) {}\nasync function main(bot) { await row(bot, 0); }",
                "it defines main, which",
            ),
            ("async function build(bot) {}\nmodule.exports = { build };", "it defines build, which"),
            ("export async function build(bot) {}", "it defines build, which"),
            ("module.exports = { name: 'wall', async run(bot) {} };", "of what it exports, a function alone"),
        ] {
            assert!(idle(code).contains(told), "{code}: {}", idle(code));
        }
        for code in
            ["const n = 5; f(n);", "const f = async () => {}; list.forEach(f);", "function f() {}\nawait f();", ""]
        {
            assert_eq!(idle(code), IDLE, "{code}");
        }
    }

    #[test]
    fn a_second_parameter_is_told_where_it_is_missing() {
        let error = |message: &str| {
            [CodeError {
                message: message.to_owned(),
                line: None,
                column: None,
                file: None,
                events: None,
                is_own: false,
            }]
        };
        let undefined = error("TypeError: cannot read property 'placeBlock' of undefined");
        let told = second_parameter("async function f(bot, skills) {}", &undefined).unwrap();
        assert!(told.contains("its parameter skills is undefined"), "{told}");
        assert_eq!(second_parameter("async function f(bot, y) {}", &undefined), None);
        assert_eq!(second_parameter("async function f(bot, skills) {}", &error("Error: no")), None);
    }
}
