//! Markdown code fences (`CommonMark`, "Fenced code blocks"), as language models write them.

use std::ops::Range;

/// A fenced code block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fence {
    /// Language of the block: the first word after the opening fence, in lower case.
    pub language: String,
    /// Byte range of the lines inside the fence.
    pub content: Range<usize>,
}

/// Finds the fenced blocks of a text, in order. A block of Markdown, or without a language, is replaced by the blocks
/// that it contains, if any.
#[must_use]
pub fn fences(text: &str) -> Vec<Fence> {
    let within = |fence: Fence| {
        let may_hold = matches!(fence.language.as_str(), "" | "markdown" | "md");
        let inner = if may_hold { outermost(&text[fence.content.clone()]) } else { Vec::new() };
        if inner.is_empty() {
            return vec![fence];
        }
        let begin = fence.content.start;
        let placed = |own: Fence| Fence { content: own.content.start + begin..own.content.end + begin, ..own };
        inner.into_iter().map(placed).collect()
    };
    outermost(text).into_iter().flat_map(within).collect()
}

/// Finds the fenced blocks that are not inside another one. A fence is a line that begins with at least three backticks
/// or tildes. An unclosed block extends to the end of the text, as when a model was stopped at the closing fence.
fn outermost(text: &str) -> Vec<Fence> {
    let mut found = Vec::new();
    let mut open: Option<(Mark, String, usize)> = None;
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let mark = Mark::of(line);
        match (&open, mark) {
            (None, Some((mark, rest))) if !(mark.sign == '`' && rest.contains('`')) => {
                let language = rest.split_whitespace().next().unwrap_or_default().to_ascii_lowercase();
                open = Some((mark, language, at + line.len()));
            }
            (Some((opening, _, _)), Some((mark, rest))) if mark.closes(*opening) && rest.trim().is_empty() => {
                if let Some((_, language, begin)) = open.take() {
                    found.push(Fence { language, content: begin..at });
                }
            }
            // Models often close a fence at the end of the last line of its content; Markdown may end a line with marks of its own.
            (Some((opening, language, _)), None)
                if opening.closes_at_end(line) && !matches!(language.as_str(), "markdown" | "md") =>
            {
                let marked = line.trim_end();
                let content = marked.trim_end_matches(opening.sign).len();
                if let Some((_, language, begin)) = open.take() {
                    found.push(Fence { language, content: begin..at + content });
                }
            }
            _ => {}
        }
        at += line.len();
    }
    if let Some((_, language, begin)) = open {
        found.push(Fence { language, content: begin.min(text.len())..text.len() });
    }
    found
}

#[derive(Debug, Clone, Copy)]
struct Mark {
    sign: char,
    length: usize,
}

impl Mark {
    /// Parses the fence at the start of a line. Returns it with the rest of the line.
    fn of(line: &str) -> Option<(Self, &str)> {
        // A byte order mark begins the texts of some programs.
        let line = line.trim_start_matches(|c: char| c.is_whitespace() || c == '\u{feff}');
        let sign = line.chars().next().filter(|sign| matches!(sign, '`' | '~'))?;
        let length = line.chars().take_while(|c| *c == sign).count();
        (length >= 3).then(|| (Self { sign, length }, &line[length..]))
    }

    fn closes(self, opening: Self) -> bool {
        self.sign == opening.sign && self.length >= opening.length
    }

    /// Returns whether this fence is closed at the end of a line of its content, with nothing else of its sign there.
    fn closes_at_end(self, line: &str) -> bool {
        let marked = line.trim_end();
        let content = marked.trim_end_matches(self.sign);
        marked.len() - content.len() == self.length && !content.contains(self.sign)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fences_are_found_with_their_languages() {
        let text = "a\n```JS title\nx\n```\n~~~~\n```\ny\n~~~~\n``` inline ``` is none\n  ```json\nz";
        let told: Vec<(String, &str)> =
            fences(text).into_iter().map(|fence| (fence.language, &text[fence.content])).collect();
        let expected = [("js", "x\n"), ("", "y\n"), ("json", "z")];
        assert_eq!(told, expected.map(|(language, content)| (language.to_owned(), content)));
        let nested = "````markdown\nSo:\n```js\ncode\n```\n````\n";
        assert_eq!(fences(nested).iter().map(|f| &nested[f.content.clone()]).collect::<Vec<_>>(), ["code\n"]);
        let nested = "```markdown\n```js\ncode\n```\n```\n";
        assert_eq!(fences(nested).first().map(|f| &nested[f.content.clone()]), Some("code\n"));
        assert_eq!(fences("```js"), [Fence { language: "js".to_owned(), content: 5..5 }]);
        assert_eq!(fences("no fence, `code` alone"), []);
        assert_eq!(fences("\u{feff}```js\na();\n```").len(), 1);
        let glued = "```js\na();\nb();```\nDone.";
        assert_eq!(fences(glued).iter().map(|f| &glued[f.content.clone()]).collect::<Vec<_>>(), ["a();\nb();"]);
        let whole = "```js\na(`x```);\nb(`y ```z```);\n```";
        assert_eq!(fences(whole).len(), 1);
    }
}
