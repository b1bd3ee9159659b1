//! The text of action code: how `export default` becomes a script, which has no exports, and hints for its author.

use rquickjs::Ctx;

const EXPORT: &str = "export default";
/// Name given to an exported function that has none. With a space it is shorter than [`EXPORT`], whose place it takes.
const NAMELESS: &str = "exportedMain";
/// Number of functions that a hint names.
const MOST_NAMED: usize = 3;

/// Action code as a script. Its lines and columns are those of the code.
#[derive(Debug, PartialEq, Eq)]
pub struct Script {
    /// Text for the engine.
    pub text: String,
    /// Name of the function declaration that the code exports. A declaration is not the value of a script.
    pub exported: Option<String>,
}

impl Script {
    /// Reads code. As in the published pipeline, `export default` is removed, which leaves a script whose value is the
    /// exported expression. Spaces replace the words, so that column numbers stay correct.
    pub fn of(code: &str) -> Self {
        let Some(at) = place_of_export(code) else { return Self { text: code.to_owned(), exported: None } };
        let (before, after) = (&code[..at], &code[at + EXPORT.len()..]);
        let blank = " ".repeat(EXPORT.len());
        let plain = |exported| Self { text: format!("{before}{blank}{after}"), exported };
        let Some(rest) = after_word(after_word(after, "async").unwrap_or(after), "function") else {
            return plain(None);
        };
        let name: String = rest.trim_start().chars().take_while(|c| is_part(*c)).collect();
        if !name.is_empty() {
            return plain(Some(name));
        }
        if !rest.trim_start().starts_with('(') {
            return plain(None);
        }
        // Only a module may declare a function without a name.
        let (words, indent) = (&after[..after.len() - rest.len()], &blank[NAMELESS.len() + 1..]);
        let text = format!("{before}{indent}{words} {NAMELESS}{rest}");
        Self { text, exported: Some(NAMELESS.to_owned()) }
    }

    /// Returns hints for the author of code that is not JavaScript; `lacks_async` says that it awaits, and could be read as
    /// the body of an async function.
    pub fn hints(&self, lacks_async: bool) -> Vec<String> {
        let mut hints = Vec::new();
        if lacks_async {
            hints.push("await is only valid in async functions: wrap the code in (async (bot) => { … })".to_owned());
        }
        let is_of_module = |line: &str| {
            let line = line.trim_start();
            ["import", "export"]
                .iter()
                .any(|word| after_word(line, word).is_some_and(|rest| !rest.starts_with(['(', '.'])))
        };
        if self.text.lines().any(is_of_module) {
            hints.push(
                "the code is run as a script, not as a module: import is not available, and the only export is one \
                 `export default` of a function"
                    .to_owned(),
            );
        }
        hints
    }
}

/// Finds the export: the first one that begins a statement, or else the first one.
fn place_of_export(code: &str) -> Option<usize> {
    let begins_statement = |at: &usize| {
        let line = code[..*at].rsplit('\n').next().unwrap_or_default().trim_end();
        line.is_empty() || line.ends_with([';', '}'])
    };
    let places = || code.match_indices(EXPORT).map(|(at, _)| at);
    places().find(begins_statement).or_else(|| places().next())
}

/// Returns the text after a word and the space before it, if it begins with them.
fn after_word<'t>(text: &'t str, word: &str) -> Option<&'t str> {
    text.trim_start().strip_prefix(word).filter(|rest| !rest.starts_with(is_part))
}

/// Returns whether a character may be part of a name.
fn is_part(c: char) -> bool {
    c.is_alphanumeric() || c == '_' || c == '$'
}

/// Returns the names of the first few functions that the code defines at its top level.
pub fn functions_of(ctx: &Ctx<'_>, code: &str) -> Vec<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '$';
    let mut words = code.split(|c| !is_part(c)).filter(|word| !word.is_empty());
    let mut found: Vec<String> = Vec::new();
    while let Some(word) = words.next() {
        if !matches!(word, "function" | "const" | "let" | "var") {
            continue;
        }
        let Some(name) = words.next().filter(|name| !name.starts_with(|c: char| c.is_ascii_digit())) else { continue };
        // A name that is local to a function is undefined here.
        let kind = ctx.eval::<String, _>(format!("typeof {name}"));
        match kind {
            Ok(kind) if kind == "function" && !found.iter().any(|known| known == name) => found.push(name.to_owned()),
            Ok(_) => {}
            // The name is a reserved word; the exception must be cleared from the engine.
            Err(_) => drop(ctx.catch()),
        }
        if found.len() == MOST_NAMED {
            break;
        }
    }
    found
}

/// Returns the likely reason why a script that ended without an error recorded nothing.
pub fn nothing_recorded(has_main: bool, functions: &[String]) -> String {
    match functions {
        _ if has_main => "the script ended without placing or removing a block".to_owned(),
        [] => "the script recorded nothing, and neither its value nor module.exports is a function to call".to_owned(),
        [first, ..] => format!(
            "the script defines {} and recorded nothing: it was never called. End the script with \
             (async (bot) => {{ await {first}(bot); }})",
            functions.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exports_become_scripts_in_which_every_place_stays() {
        let cases = [
            ("export default (bot) => {}", "               (bot) => {}", None),
            ("export default function build(bot) {}", "               function build(bot) {}", Some("build")),
            ("export default function (bot) {}", "  function exportedMain (bot) {}", Some("exportedMain")),
            ("export default async function(bot) {}", "  async function exportedMain(bot) {}", Some("exportedMain")),
            ("export default functions", "               functions", None),
            ("f(); export default f", "f();                f", None),
            ("// export default is f\nexport default f", "// export default is f\n               f", None),
            ("f", "f", None),
        ];
        for (code, text, exported) in cases {
            let script = Script::of(code);
            assert_eq!((script.text.as_str(), script.exported.as_deref()), (text, exported), "{code}");
        }
    }

    #[test]
    fn the_words_of_modules_are_explained() {
        let hinted = |code: &str| Script::of(code).hints(false).iter().any(|hint| hint.contains("not as a module"));
        assert!(hinted("import fs from 'fs'; export default f"));
        assert!(hinted("export const x = 1;\nexport default f"));
        assert!(!hinted("export default (bot) => {"));
        assert!(!hinted("import('fs') ]"));
    }
}
