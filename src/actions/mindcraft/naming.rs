//! Errors that name the function that is meant: the engine only says that something is not a function.

use super::host::Missing;
use crate::actions::CodeError;
use crate::actions::functions::functions_of;
use plumbline_engine::text::did_you_mean;
use plumbline_engine::voxel::Profile;

/// Puts the name of what is not a function into an error that lacks it.
pub fn name(error: &mut CodeError, code: &str, missing: Option<&Missing>) {
    if error.message != "TypeError: not a function" || !error.is_own {
        return;
    }
    let line = error.line.and_then(|line| code.lines().nth((line as usize).checked_sub(1)?)).unwrap_or_default();
    let is_on_line = |missing: &&Missing| {
        missing.path.split_once('.').is_some_and(|(_, name)| line.is_empty() || line.contains(name))
    };
    error.message = match missing.filter(is_on_line) {
        Some(Missing { path, suggestion }) => format!("TypeError: {path} is not a function{suggestion}"),
        // Of several calls on a line, nobody knows which one failed.
        None => match called(line).collect::<Vec<_>>().as_slice() {
            [name] => format!("TypeError: {name} is not a function"),
            _ => return,
        },
    };
}

/// Adds what may be meant by a name that is not defined: a skill without `skills.`, or a name that is nearly that of an
/// object.
pub fn suggest(error: &mut CodeError) {
    let undefined =
        error.message.strip_prefix("ReferenceError: ").and_then(|rest| rest.strip_suffix(" is not defined"));
    let Some(undefined) = undefined else { return };
    let paths = || functions_of(Profile::Mindcraft).iter().filter_map(|known| known.call.split('(').next());
    let suggestion = match paths().find(|path| path.split_once('.').is_some_and(|(_, name)| name == undefined)) {
        Some(path) => format!("; did you mean {path}?"),
        None => did_you_mean(undefined, OBJECTS.into_iter().chain(paths().filter_map(|path| path.split('.').nth(1)))),
    };
    error.message.push_str(&suggestion);
}

/// Adds which character a syntax error is about: models write quotes and signs that JavaScript takes in strings only.
pub fn show_character(error: &mut CodeError, code: &str) {
    if error.message != "SyntaxError: unexpected character" {
        return;
    }
    let line = error.line.and_then(|line| code.lines().nth((line as usize).checked_sub(1)?)).unwrap_or_default();
    // Letters are names, and spaces of all kinds are spaces.
    let is_odd = |c: &char| !c.is_ascii() && !c.is_alphabetic() && !c.is_whitespace() && *c != '\u{feff}';
    let is_quote = |c: char| matches!(c, '\'' | '"' | '`');
    let outside_strings = line.split(is_quote).step_by(2);
    if let Some(odd) = outside_strings.flat_map(str::chars).find(is_odd) {
        // A character that only formats would not be seen, or disturb the rest of the message.
        let is_seen = !matches!(odd, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{fe00}'..='\u{fe0f}');
        let shown = if is_seen && !odd.is_control() { format!(" ({odd})") } else { String::new() };
        error.message = format!("{}; the line has U+{:04X}{shown}", error.message, u32::from(odd));
    }
}

/// Global names that code finds.
const OBJECTS: [&str; 6] = ["skills", "world", "bot", "log", "Vec3", "console"];

/// Returns what is called on a line, such as `skills.placeBlock`.
fn called(line: &str) -> impl Iterator<Item = &str> {
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '$' | '.');
    line.match_indices('(').filter_map(move |(at, _)| {
        let before = line[..at].trim_end();
        let begin =
            before.rfind(|c| !is_part(c)).map_or(0, |at| at + before[at..].chars().next().map_or(1, char::len_utf8));
        let name = before[begin..].trim_matches('.');
        let is_word =
            matches!(name, "" | "if" | "for" | "while" | "switch" | "catch" | "function" | "return" | "await");
        (!is_word).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_characters_are_shown() {
        let told = |code: &str, line| {
            let message = "SyntaxError: unexpected character".to_owned();
            let mut error = CodeError { message, line, column: None, file: None, events: None, is_own: true };
            show_character(&mut error, code);
            error.message
        };
        assert_eq!(told("a();\nb(“x”);", Some(2)), "SyntaxError: unexpected character; the line has U+201C (“)");
        assert_eq!(told("b(−1);", Some(1)), "SyntaxError: unexpected character; the line has U+2212 (−)");
        assert_eq!(
            told("a('–');\u{a0}b\u{200b}(1);", Some(1)),
            "SyntaxError: unexpected character; the line has U+200B"
        );
        assert_eq!(told("b(²);", Some(1)), "SyntaxError: unexpected character; the line has U+00B2 (²)");
        assert_eq!(told("b(#);", Some(1)), "SyntaxError: unexpected character");
        assert_eq!(told("b();", None), "SyntaxError: unexpected character");
    }

    #[test]
    fn what_is_not_defined_may_be_a_skill() {
        let told = |message: &str| {
            let message = message.to_owned();
            let mut error = CodeError { message, line: None, column: None, file: None, events: None, is_own: true };
            suggest(&mut error);
            error.message
        };
        let undefined = |name: &str| told(&format!("ReferenceError: {name} is not defined"));
        assert!(undefined("placeBlock").ends_with("placeBlock is not defined; did you mean skills.placeBlock?"));
        assert!(undefined("skill").ends_with("did you mean skills?"), "{}", undefined("skill"));
        assert!(undefined("frobnicate").ends_with("is not defined"));
        assert_eq!(told("TypeError: x is not defined"), "TypeError: x is not defined");
    }

    #[test]
    fn the_calls_of_a_line_are_named() {
        let names = |line| called(line).collect::<Vec<_>>();
        assert_eq!(names("  await skills.goTo(bot, 1);"), ["skills.goTo"]);
        assert_eq!(names("    .zap(3);"), ["zap"]);
        assert_eq!(names("if (a.b(c(1))) return (2)"), ["a.b", "c"]);
    }
}
