//! The raw answer of a language model: which part of it is code, as mindcraft's coder reads it.

use plumbline_engine::intake::text::thinking::{left_out, without_thoughts};
use plumbline_engine::text::{did_you_mean, line_of};
use plumbline_engine::voxel::blocks;

/// Marks around code.
const FENCE: &str = "```";
/// Words after a fence that mindcraft removes, in the order in which it looks for them.
const LANGUAGES: [&str; 3] = ["Javascript", "javascript", "js"];
/// Words after a fence, in any letter case, that stand for JavaScript, but that mindcraft leaves in the code, where they
/// are an error.
const OTHER_LANGUAGES: [&str; 8] = ["javascript", "js", "typescript", "ts", "jsx", "mjs", "cjs", "node"];

/// Code in an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reading {
    /// The code, on the lines that it has in the answer.
    pub code: String,
    /// What the author should know of the reading, such as where it is more lenient than mindcraft's.
    pub notes: Vec<String>,
    /// What explains an error of the code, if it has one.
    pub if_it_fails: Option<String>,
}

/// Note on code that fails and stands in no fence.
const NO_FENCE: &str =
    "without a code fence (```) the whole answer is read as code; put the code, and nothing else, in one fence";

/// Note on TypeScript that fails.
const TYPES: &str = "the code is run as JavaScript, which has no types: leave out `: type`, `as` and `interface`";

/// Reads an answer: the code is what stands between the first and the last fence, or the whole text if there is none.
pub fn read(sent: &str) -> Reading {
    let mut notes = Vec::new();
    let (shown, ends_in_thought) = without_thoughts(sent);
    if ends_in_thought {
        notes.extend(left_out(sent));
    }
    let left_out = || left_out(sent).filter(|_| !ends_in_thought).map(|why| format!("; {why}")).unwrap_or_default();
    let (Some(first), Some(last)) = (shown.find(FENCE), shown.rfind(FENCE)) else {
        return Reading { code: shown, notes, if_it_fails: Some(format!("{NO_FENCE}{}", left_out())) };
    };
    // A fence may have more than three marks.
    let begin = first + shown[first..].bytes().take_while(|byte| *byte == b'`').count();
    let end = if last >= begin {
        last
    } else {
        let before = &shown[..first];
        // Only the closing fence is there, because the opening one is in the prompt, or the answer was cut off.
        if !before.trim().is_empty() && shown[begin..].trim().is_empty() {
            notes.push("the answer has a closing fence only; what precedes it was taken as the code".to_owned());
            return Reading { code: before.to_owned(), notes, if_it_fails: None };
        }
        if !ends_in_thought {
            notes.push(format!("the answer ends without a closing fence, so it may be incomplete{}", left_out()));
        }
        shown.len()
    };
    let end = end - shown[begin..end].bytes().rev().take_while(|byte| *byte == b'`').count();
    let code = shown[begin..end].trim_start();
    let word = word_of(code);
    let code = match word {
        Some(word) if OTHER_LANGUAGES.contains(&word.to_lowercase().as_str()) && !LANGUAGES.contains(&word) => {
            notes.push(format!("the word {word} after the fence was left out, which mindcraft does not do"));
            &code[word.len()..]
        }
        Some(word) if !LANGUAGES.contains(&word) && !is_json(&code[word.len()..]) => {
            let left = LANGUAGES.iter().find_map(|language| word.strip_prefix(language)).unwrap_or(word);
            notes.push(format!(
                "the word {word} after the fence is no language of action code; of it {left:?} is read as code"
            ));
            &code[word.len() - left.len()..]
        }
        _ => LANGUAGES.iter().find_map(|word| code.strip_prefix(word)).unwrap_or(code),
    };
    // Another word than a language has a note already, and so will JSON.
    let is_told = word.is_some_and(|word| !LANGUAGES.contains(&word)) || is_json(code);
    let is_typed = word.is_some_and(|word| ["ts", "typescript"].contains(&word.to_lowercase().as_str()));
    let if_it_fails = if is_typed { Some(TYPES.to_owned()) } else { beside_the_fence(code).filter(|_| !is_told) };
    let lines = shown[..end - code.len()].matches('\n').count();
    Reading { code: format!("{}{code}", "\n".repeat(lines)), notes, if_it_fails }
}

/// Note on an answer that is JSON instead of code.
pub const JSON_IS_NO_CODE: &str = "the answer is JSON, which builds nothing when it runs as code; send a block log as events, rows or turns, and code in a code fence";

/// Returns whether the code of an answer is JSON: a list or an object.
pub fn is_json(code: &str) -> bool {
    let code = code.trim();
    // Of the fence's word "json", "js" was taken for the language.
    let value = code.strip_prefix("on").unwrap_or(code).trim_start();
    value.starts_with(['{', '[']) && serde_json::from_str::<serde::de::IgnoredAny>(value).is_ok()
}

/// Returns the word that stands alone on the first line of the code, if there is one.
fn word_of(code: &str) -> Option<&str> {
    let word = code.split_once('\n')?.0.trim_end();
    let is_word = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "+#-".contains(c));
    is_word.then_some(word)
}

/// Explains what stands on the line of the fence after its language, such as a title, if code follows on other lines.
fn beside_the_fence(code: &str) -> Option<String> {
    let beside = code.split_once('\n')?.0.trim();
    let told =
        || format!("{:?} on the line of the code fence is read as code, as mindcraft reads it", shortened(beside));
    (!beside.is_empty()).then(told)
}

fn shortened(text: &str) -> &str {
    text.char_indices().nth(60).map_or(text, |(at, _)| &text[..at])
}

/// Rewrites the body of a function as mindcraft's coder does before it runs it. The lines stay.
pub fn rewritten(code: &str) -> String {
    code.replace("console.log(", "log(bot,")
        .replace("log(\"", "log(bot,\"")
        .replace(";\n", "; if(bot.interrupt_code) {log(bot, \"interrupted\");return;}\n")
}

/// Returns the line of the first `else` that follows a statement without braces which mindcraft adds a check to: it then
/// belongs to that check.
pub fn else_of_check(code: &str) -> Option<usize> {
    let is_else = |rest: &str| {
        let word = rest.strip_prefix("else");
        word.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || matches!(c, '_' | '$' | ':')))
    };
    code.match_indices(";\n").find_map(|(at, check)| {
        let rest = &code[at + check.len()..];
        let other = rest.trim_start();
        is_else(other).then(|| line_of(code, code.len() - other.len()))
    })
}

/// Adds names of blocks to the reason of a call that named none.
pub fn with_suggestion(reason: String) -> String {
    let named = reason.strip_prefix('\'').and_then(|rest| rest.strip_suffix("' is not the name of a block"));
    let meant = named.map(|name| did_you_mean(&name.to_lowercase().replace(' ', "_"), blocks::names()));
    let has_state = named.is_some_and(|name| name.contains('['));
    let of_state = "; skills take names without a state, which a command takes: bot.chat('/setblock 0 0 0 oak_stairs[facing=north]')";
    if has_state { reason + of_state } else { reason + &meant.unwrap_or_default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_engine::intake::text::thinking::thoughts_removed;

    #[test]
    fn an_else_that_a_check_takes_is_found() {
        assert_eq!(else_of_check("if (a)\n  f();\nelse\n  g();"), Some(3));
        assert_eq!(else_of_check("if (a) f();\n\n  else g();"), Some(3));
        for code in [
            "if (a) { f();\n} else { g();\n}",
            "f();\nelsewhere();",
            "if (a) f(); else g();",
            "const o = {\na: f(),\nelse: 1 };",
        ] {
            assert_eq!(else_of_check(code), None, "{code}");
        }
    }

    #[test]
    fn a_misspelt_block_is_answered_with_names() {
        for (name, meant) in [("stoone", "stone"), ("Stone", "stone"), ("oak planks", "oak_planks")] {
            let told = with_suggestion(format!("'{name}' is not the name of a block"));
            assert!(told.contains("; did you mean ") && told.contains(meant), "{told}");
        }
        let stated = with_suggestion("'oak_stairs[facing=north]' is not the name of a block".to_owned());
        assert!(stated.contains("; skills take names without a state"), "{stated}");
        assert_eq!(with_suggestion("the cell is out of range".to_owned()), "the cell is out of range");
    }

    #[test]
    fn json_is_told_from_code() {
        for json in ["{}", " [1]\n", "on\n{\"events\": []}", "{\"code\": \"f();\"}"] {
            assert!(is_json(json), "{json}");
        }
        for code in ["{ f(); }", "f();", "[f()]", "1", "on"] {
            assert!(!is_json(code), "{code}");
        }
    }

    #[test]
    fn code_stands_between_the_first_and_the_last_fence() {
        for (sent, code, notes) in [
            ("a();", "a();", 0),
            ("Sure:\n```js\na();\n```\nDone.", "\n\na();\n", 0),
            ("```javascript\r\na();\r\n```", "\r\na();\r\n", 0),
            ("```\na();\n```", "\na();\n", 0),
            ("```js\na();\n```\nand\n```js\nb();\n```", "\na();\n```\nand\n```js\nb();\n", 0),
            ("```ts\na();\n```", "\na();\n", 1),
            ("```js\na();", "\na();", 1),
            ("a();\n```", "a();\n", 1),
            ("```tsx_thing()\n```", "tsx_thing()\n", 0),
            ("````js\na();\n````", "\na();\n", 0),
            ("````js\na();", "\na();", 1),
            ("```jsx\na();\n```", "\na();\n", 1),
            ("```JAVASCRIPT \na();\n```", " \na();\n", 1),
            ("```JS\r\na();\n```", "\r\na();\n", 1),
            ("```Javascript\na();\n```", "\na();\n", 0),
            ("```json\na();\n```", "on\na();\n", 1),
            ("```json\n{\"a\": 1}\n```", "on\n{\"a\": 1}\n", 0),
            ("```python\na();\n```", "python\na();\n", 1),
            ("```\nlet a = 1\n```", "\nlet a = 1\n", 0),
            ("```", "", 1),
        ] {
            let reading = read(sent);
            assert_eq!((reading.code.as_str(), reading.notes.len()), (code, notes), "{sent:?}");
        }
        for (sent, told) in [
            (
                "```js title=\"b.js\"\na();\n```",
                Some("\"title=\\\"b.js\\\"\" on the line of the code fence is read as code, as mindcraft reads it"),
            ),
            (
                "```javascript:build.js\na();\n```",
                Some("\":build.js\" on the line of the code fence is read as code, as mindcraft reads it"),
            ),
            ("```js a();\n```", Some("\"a();\" on the line of the code fence is read as code, as mindcraft reads it")),
            ("```js\na();\n```", None),
            ("```python\na();\n```", None),
            ("```json\n{\"a\": 1}\n```", None),
            ("~~~js\na();\n~~~", Some(NO_FENCE)),
            ("```ts\nconst b = bot as any;\n```", Some(TYPES)),
        ] {
            assert_eq!(read(sent).if_it_fails.as_deref(), told, "{sent}");
        }
        let cut = read("```js\na('<think>');\nb();\n```");
        let note = "the answer ends inside a thinking tag that is never closed: <think> in line 2";
        assert_eq!((cut.code.trim(), cut.notes), ("a('", vec![note.to_owned()]));
        let cut = read("```js\na();\n<|im_end|>\nb();\n```");
        assert!(cut.notes[0].ends_with("so it may be incomplete; everything after <|im_end|> in line 3 was left out"));
        // What is found in a text keeps the tag.
        let found = thoughts_removed("é\n```js\na();\n```<think>x```");
        assert_eq!((read(&found).code.trim(), read(&found).notes.len()), ("a();", 1));
        let thought = read("<think>\n```js\nno();\n```\n</think>\n```js\na();\n```");
        assert_eq!(thought.code.trim(), "a();");
        assert_eq!(thought.code.find("a();"), Some(6));
    }
}
