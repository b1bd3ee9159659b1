//! Removal of a model's thoughts, which are not part of its answer.

/// Names of the tags that enclose thoughts.
const TAGS: [&str; 5] = ["think", "thinking", "thought", "reasoning", "scratchpad"];

/// Length in bytes of the longest tag name.
const LONGEST: usize = 10;

/// Replaces thinking tags and the thoughts between them with spaces, which keeps line numbers and byte offsets, and
/// also returns whether the text ends inside a thought.
///
/// An unclosed tag extends to the end of the text. Everything before a closing tag without an opening one is a thought,
/// because some templates put the opening tag into the prompt.
#[must_use]
pub fn without_thoughts(text: &str) -> (String, bool) {
    let (shown, unclosed) = blanked(text);
    (shown, unclosed.is_some())
}

/// Does the same as [`without_thoughts`], and returns the tag that is never closed.
fn blanked(text: &str) -> (String, Option<Tag>) {
    let mut shown = text.as_bytes().to_vec();
    let mut blank = |from: usize, to: usize| {
        for byte in &mut shown[from..to] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
    };
    let (mut opened, mut stray): (Option<Tag>, usize) = (None, 0);
    for tag in tags(text) {
        match (&opened, tag.is_closing) {
            (None, false) => opened = Some(tag),
            (Some(open), true) => {
                blank(open.begin, tag.end);
                opened = None;
            }
            (None, true) => stray = tag.end,
            // An opening tag inside a thought has no effect.
            (Some(_), false) => {}
        }
    }
    blank(0, stray);
    if let Some(open) = &opened {
        blank(open.begin, text.len());
    }
    // Each byte of a blanked character became a space, so the text is still valid UTF-8.
    (String::from_utf8_lossy(&shown).into_owned(), opened)
}

/// Removes thinking tags and the thoughts between them. Lines keep their numbers; what is left of a line with a thought
/// loses the spaces around it. A tag that is never closed stays, so that whoever reads the rest can tell.
#[must_use]
pub fn thoughts_removed(text: &str) -> String {
    let (shown, unclosed) = blanked(text);
    let (end, tag) = unclosed.map_or((text.len(), ""), |tag| (tag.begin, &text[tag.begin..tag.end]));
    let (text, shown) = (&text[..end], &shown[..end]);
    let mut kept = String::new();
    for (sent, shown) in text.split_inclusive('\n').zip(shown.split_inclusive('\n')) {
        if sent == shown {
            kept.push_str(sent);
        } else {
            kept.push_str(shown.trim());
            kept.push_str(if shown.ends_with('\n') { "\n" } else { "" });
        }
    }
    kept + tag
}

struct Tag {
    begin: usize,
    end: usize,
    is_closing: bool,
}

fn tags(text: &str) -> impl Iterator<Item = Tag> {
    text.match_indices('<').filter_map(|(begin, _)| {
        let rest = &text[begin + 1..];
        let (is_closing, name) = rest.strip_prefix('/').map_or((false, rest), |name| (true, name));
        let length = name.bytes().take(LONGEST + 1).position(|byte| byte == b'>')?;
        let is_one = TAGS.iter().any(|tag| name[..length].eq_ignore_ascii_case(tag));
        is_one.then(|| Tag { begin, end: begin + 1 + usize::from(is_closing) + length + 1, is_closing })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> (String, bool) {
        let (shown, is_open) = without_thoughts(text);
        assert_eq!(shown.len(), text.len());
        (shown.split_whitespace().collect::<Vec<_>>().join(" "), is_open)
    }

    #[test]
    fn thoughts_are_left_out() {
        for (text, expected) in [
            ("<think>a\nb</think> c", ("c", false)),
            ("draft é</think>c <Thinking>d</THINKING>e", ("c e", false)),
            ("a <think>b <think> c</think> d", ("a d", false)),
            ("a <reasoning>never ends", ("a", true)),
            ("a <think>b</think> c</think>d", ("d", false)),
            ("1 < 2 and <b>bold</b>", ("1 < 2 and <b>bold</b>", false)),
        ] {
            assert_eq!(shown(text), (expected.0.to_owned(), expected.1), "{text}");
        }
        let text = "<think>a\nb</think>```js\n  c();\n```<think>d";
        assert_eq!(thoughts_removed(text), "\n```js\n  c();\n```<think>");
        assert_eq!(without_thoughts("<think>\n\n</think>x").0.matches('\n').count(), 2);
    }
}
