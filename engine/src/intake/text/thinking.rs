//! Removal of what a model's raw output holds beside its answer: its thoughts, and tokens around the message.

use std::ops::Range;

use super::template;
use crate::text::line_of;

/// Names of the tags that enclose thoughts, as in `<think>` and `</think>`, in any letter case.
const TAGS: [&str; 7] = ["think", "thinking", "thought", "reasoning", "scratchpad", "seed:think", "longcat_think"];

/// Length in bytes of the longest tag name.
const LONGEST: usize = 13;

/// Tokens that enclose thoughts in the raw output of a family of models: the opening one and the closing one.
const TOKENS: [(&str, &str); 6] = [
    // Mistral.
    ("[THINK]", "[/THINK]"),
    // Kimi.
    ("◁think▷", "◁/think▷"),
    // Cohere.
    ("<|START_THINKING|>", "<|END_THINKING|>"),
    // OpenThinker.
    ("<|begin_of_thought|>", "<|end_of_thought|>"),
    // Apertus.
    ("<|inner_prefix|>", "<|inner_suffix|>"),
    // Gemma.
    ("<|channel>", "<channel|>"),
];

/// Tokens that begin the answer, so that everything before them is thought.
const ANSWERS: [&str; 1] = [
    // Cohere.
    "<|START_RESPONSE|>",
];

/// Token of gpt-oss (the Harmony format) that begins the name of a channel. The answer is in the channel `final`.
const CHANNEL: &str = "<|channel|>";
/// Token of Harmony between the head of a message and its text.
const MESSAGE: &str = "<|message|>";
/// Most bytes of the head of a Harmony message, which may name a recipient and a format.
const LONGEST_HEAD: usize = 200;

/// Replaces thinking tags, the thoughts between them and the tokens around the message with spaces, which keeps line
/// numbers and byte offsets, and also returns whether the text ends inside a thought.
///
/// An unclosed tag extends to the end of the text. Everything before a closing tag without an opening one is a thought,
/// because some templates put the opening tag into the prompt; but not if a thought was closed before.
#[must_use]
pub fn without_thoughts(text: &str) -> (String, bool) {
    let Blanked { shown, unclosed, stray: _ } = blanked(text);
    (shown, unclosed.is_some())
}

/// A text whose thoughts are blank.
struct Blanked {
    shown: String,
    /// The opening tag that is never closed.
    unclosed: Option<Tag>,
    /// The last closing tag without an opening one that ends thoughts.
    stray: Option<Tag>,
}

fn blanked(text: &str) -> Blanked {
    let mut shown = text.as_bytes().to_vec();
    let (begin, mut opened) = match bare_channels(text) {
        None => (0, None),
        Some(Bare::Answer(at)) => (at, None),
        Some(Bare::Thought(tag)) => (text.len(), Some(tag)),
    };
    blank(&mut shown, 0..begin);
    let mut stray = None;
    // A thought may have held an opening tag, and then ends with the second closing one.
    let (mut is_any_closed, mut is_nested) = (false, false);
    for tag in tags(text).filter(|tag| tag.begin >= begin) {
        match (&opened, tag.is_closing) {
            (None, false) => {
                is_nested = false;
                opened = Some(tag);
            }
            (Some(open), true) => {
                blank(&mut shown, open.begin..tag.end);
                is_any_closed = true;
                opened = None;
            }
            (None, true) if is_any_closed && !is_nested => blank(&mut shown, tag.begin..tag.end),
            (None, true) => {
                blank(&mut shown, 0..tag.end);
                (is_any_closed, is_nested) = (true, false);
                stray = Some(tag);
            }
            (Some(_), false) => is_nested = true,
        }
    }
    if let Some(open) = &opened {
        blank(&mut shown, open.begin..text.len());
    }
    // Each byte of a blanked character became a space, so the text is still valid UTF-8.
    let mut shown = String::from_utf8(shown).expect("whole characters are blanked");
    let message = template::message(&shown);
    if message != (0..shown.len()) {
        let mut bytes = shown.into_bytes();
        let length = bytes.len();
        blank(&mut bytes, 0..message.start);
        blank(&mut bytes, message.end..length);
        shown = String::from_utf8(bytes).expect("whole characters are blanked");
    }
    Blanked { shown, unclosed: opened, stray }
}

/// Replaces what is no line break with spaces.
fn blank(bytes: &mut [u8], range: Range<usize>) {
    for byte in &mut bytes[range] {
        if *byte != b'\n' {
            *byte = b' ';
        }
    }
}

/// Returns the line and the name of the tag that opens a thought which never ends.
#[must_use]
pub fn unclosed(text: &str) -> Option<(usize, &str)> {
    let tag = blanked(text).unclosed?;
    Some((line_of(text, tag.begin), &text[tag.begin..tag.end]))
}

/// Returns the line and the name of the closing tag without an opening one before which everything was taken for thoughts.
#[must_use]
pub fn closed_without_opening(text: &str) -> Option<(usize, &str)> {
    let tag = blanked(text).stray?;
    Some((line_of(text, tag.begin), &text[tag.begin..tag.end]))
}

/// Returns the opening tag at the end of a prompt, which the answer to it goes on from.
#[must_use]
pub fn opened_at_the_end(prompt: &str) -> Option<&str> {
    let prompt = prompt.trim_end();
    let last = prompt.rfind(['<', '[', '◁'])?;
    let tag = tags(&prompt[last..]).next().filter(|tag| tag.begin == 0 && !tag.is_closing)?;
    let opening = &prompt[last..];
    (tag.end == opening.len()).then_some(opening)
}

/// Returns whether a text begins with a thought.
#[must_use]
pub fn begins_with_thought(text: &str) -> bool {
    let begin = text.len() - text.trim_start().len();
    tags(text).next().is_some_and(|tag| tag.begin == begin && !tag.is_closing)
}

/// Removes thinking tags and the thoughts between them. Lines keep their numbers; what is left of a line with a thought
/// loses the spaces around it. A tag that is never closed stays, so that whoever reads the rest can tell.
#[must_use]
pub fn thoughts_removed(text: &str) -> String {
    let Blanked { shown, unclosed, stray: _ } = blanked(text);
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

/// Returns the tags and tokens that open or close a thought, in order.
fn tags(text: &str) -> impl Iterator<Item = Tag> {
    text.match_indices(['<', '[', '◁']).filter_map(|(begin, _)| {
        let rest = &text[begin..];
        let (length, is_closing) = named(rest).or_else(|| token(rest)).or_else(|| channel(rest))?;
        Some(Tag { begin, end: begin + length, is_closing })
    })
}

/// Returns the length of the tag of [`TAGS`] that a text begins with, and whether it closes.
fn named(text: &str) -> Option<(usize, bool)> {
    let rest = text.strip_prefix('<')?;
    let (is_closing, name) = rest.strip_prefix('/').map_or((false, rest), |name| (true, name));
    let length = name.bytes().take(LONGEST + 1).position(|byte| byte == b'>')?;
    let is_one = TAGS.iter().any(|tag| name[..length].eq_ignore_ascii_case(tag));
    is_one.then(|| (text.len() - name.len() + length + 1, is_closing))
}

/// Returns the length of the token of [`TOKENS`] or [`ANSWERS`] that a text begins with, and whether it closes.
fn token(text: &str) -> Option<(usize, bool)> {
    let opening = TOKENS.iter().map(|(opening, _)| (*opening, false));
    let closing = TOKENS.iter().map(|(_, closing)| *closing).chain(ANSWERS).map(|token| (token, true));
    let mut tokens = opening.chain(closing);
    tokens.find_map(|(token, is_closing)| text.starts_with(token).then_some((token.len(), is_closing)))
}

/// Returns the length of the head of a Harmony message that a text begins with, and whether it closes the thoughts, which
/// that of the channel `final` does.
fn channel(text: &str) -> Option<(usize, bool)> {
    let name = text.strip_prefix(CHANNEL)?;
    let is_final = name.starts_with("final");
    let head = name[..name.floor_char_boundary(LONGEST_HEAD)].find(MESSAGE);
    let length = head.map_or(if is_final { "final".len() } else { 0 }, |length| length + MESSAGE.len());
    Some((CHANNEL.len() + length, is_final))
}

/// Harmony output that was decoded without its tokens, which leaves `analysis…assistantfinal…`.
enum Bare {
    /// The answer begins here.
    Answer(usize),
    /// The output ends in the thoughts, which begin with this tag.
    Thought(Tag),
}

/// Returns what a text is if it is Harmony output that was decoded without its tokens.
fn bare_channels(text: &str) -> Option<Bare> {
    const ANALYSIS: &str = "analysis";
    const FINAL: &str = "assistantfinal";
    let begin = text.len() - text.trim_start().len();
    let thought = text[begin..].strip_prefix(ANALYSIS)?;
    if let Some(at) = text.rfind(FINAL) {
        return Some(Bare::Answer(at + FINAL.len()));
    }
    // The first word of the thoughts follows without a space, and has a capital letter.
    let is_thought = thought.chars().next().is_some_and(|c| c.is_alphabetic() && !c.is_lowercase());
    is_thought.then(|| Bare::Thought(Tag { begin, end: begin + ANALYSIS.len(), is_closing: false }))
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
    fn marks_without_number_are_read_in_one_pass() {
        const MARKS: usize = 300_000;
        for mark in ["<|im_end|>", "<|channel|>", "<|channel|>final", "<", "◁", "[", "<|", "|>", "</think>", "<think>"]
        {
            let text = format!("a {}", mark.repeat(MARKS));
            assert_eq!(without_thoughts(&text).0.len(), text.len());
        }
        let long = format!("<|channel|>analysis{}", "é".repeat(LONGEST_HEAD));
        assert_eq!(shown(&long), (String::new(), true));
    }

    #[test]
    fn thoughts_are_left_out() {
        for (text, expected) in [
            ("<think>a\nb</think> c", ("c", false)),
            ("draft é</think>c <Thinking>d</THINKING>e", ("c e", false)),
            ("a <think>b <think> c</think> d", ("a d", false)),
            ("a <reasoning>never ends", ("a", true)),
            ("a <think>b</think> c</think>d", ("a c d", false)),
            ("<think>a <think>b</think> c</think>d", ("d", false)),
            ("<think>a</think>b\n</think>", ("b", false)),
            ("1 < 2 and <b>bold</b>", ("1 < 2 and <b>bold</b>", false)),
            ("[THINK]a [0][/THINK]b [1]", ("b [1]", false)),
            ("a◁/think▷b ◁think▷c", ("b", true)),
            ("<seed:think>a</seed:think>b", ("b", false)),
            ("a</longcat_think>b", ("b", false)),
            ("<|START_THINKING|>a<|END_THINKING|><|START_RESPONSE|>b<|END_RESPONSE|>", ("b", false)),
            ("<|channel>thought\na<channel|>b<turn|>", ("b", false)),
            (
                "<|channel|>analysis<|message|>a<|end|><|start|>assistant<|channel|>final<|message|>b<|return|>",
                ("b", false),
            ),
            ("<|channel|>commentary to=f <|constrain|>json<|message|>{}<|call|>", ("", true)),
            ("<|channel|>final <|constrain|>json<|message|>{}", ("{}", false)),
            ("analysisWe build.assistantfinalb", ("b", false)),
            ("analysisA tag </think> or <think>.assistantfinalb", ("b", false)),
            ("the analysis of assistantfinal", ("the analysis of assistantfinal", false)),
            ("b\n```<|im_end|>\n", ("b ```", false)),
            ("b</s><|eot_id|>", ("b", false)),
            ("<think>a</think><|im_start|>assistant\nb<|im_end|>\nc", ("b", false)),
            ("analysisWe need to build.", ("", true)),
            ("analysis: b", ("analysis: b", false)),
        ] {
            assert_eq!(shown(text), (expected.0.to_owned(), expected.1), "{text}");
        }
        assert_eq!(unclosed("a\n<Thinking>b"), Some((2, "<Thinking>")));
        assert_eq!(closed_without_opening("a\n\nb [/THINK]c"), Some((3, "[/THINK]")));
        assert_eq!(closed_without_opening("<think>a</think>b</think>"), None);
        assert_eq!(opened_at_the_end("user: build\nassistant: <think>\n"), Some("<think>"));
        assert_eq!(opened_at_the_end("<think>plan</think>"), None);
        assert_eq!(opened_at_the_end("<think> a"), None);
        assert!(
            begins_with_thought(" [THINK]a") && !begins_with_thought("a <think>") && !begins_with_thought("</think>")
        );
        let text = "<think>a\nb</think>```js\n  c();\n```<think>d";
        assert_eq!(thoughts_removed(text), "\n```js\n  c();\n```<think>");
        assert_eq!(without_thoughts("<think>\n\n</think>x").0.matches('\n').count(), 2);
    }
}
