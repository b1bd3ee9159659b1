//! The text of action code: how `export default` becomes a script, which has no exports, and hints for its author.

use rquickjs::Ctx;

const EXPORT: &str = "export default";
/// Number of functions that a hint names.
const MAX_NAMED: usize = 3;

/// Action code as a script. Its lines and columns are those of the code.
#[derive(Debug, PartialEq, Eq)]
pub struct Script {
    /// Text for the engine.
    pub text: String,
    /// Byte of the text at which the words that were taken out ended; none if there were none.
    export: Option<usize>,
}

impl Script {
    /// Reads code. As in the published pipeline, the first `export default` of the text is taken out, which leaves a script
    /// whose value is the exported expression. A function declaration has no value: it is defined, and not called.
    /// Spaces replace the words, so that column numbers stay correct.
    pub fn of(code: &str) -> Self {
        let export = code.find(EXPORT).map(|at| at + EXPORT.len());
        Self { text: code.replacen(EXPORT, &" ".repeat(EXPORT.len()), 1), export }
    }

    /// Returns hints for the author of code that is not JavaScript; `lacks_async` says that it awaits, and could be read as
    /// the body of an async function.
    pub fn hints(&self, lacks_async: bool) -> Vec<String> {
        let mut hints = Vec::new();
        if lacks_async {
            hints.push("await is only valid in async functions: wrap the code in (async (bot) => { … })".to_owned());
        }
        if self.exports_nameless_function() {
            hints.push(
                "`export default` is taken out, and a function without a name is no statement: write export default \
                 async (bot) => { … }"
                    .to_owned(),
            );
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

    fn exports_nameless_function(&self) -> bool {
        let after = self.export.map(|at| &self.text[at..]);
        let after = after.and_then(|after| after_word(after_word(after, "async").unwrap_or(after), "function"));
        after.is_some_and(|rest| rest.trim_start().starts_with('('))
    }
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
        if found.len() == MAX_NAMED {
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
            ("export default (bot) => {}", "               (bot) => {}", false),
            ("export default function build(bot) {}", "               function build(bot) {}", false),
            ("export default function (bot) {}", "               function (bot) {}", true),
            ("export default async function(bot) {}", "               async function(bot) {}", true),
            ("f(); export default f", "f();                f", false),
            ("// export default\nexport default f", "//               \nexport default f", false),
            ("f", "f", false),
        ];
        for (code, text, is_nameless) in cases {
            let script = Script::of(code);
            assert_eq!((script.text.as_str(), script.exports_nameless_function()), (text, is_nameless), "{code}");
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
