//! Removal of what a model's raw output holds beside its answer: its thoughts, and tokens that end a message.

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

/// Tokens without bars that end a message; those with bars have the form `<|name|>`.
const END_TOKENS: [&str; 3] = ["</s>", "<end_of_turn>", "<turn|>"];

/// Replaces thinking tags, the thoughts between them and the end tokens of the text with spaces, which keeps line numbers
/// and byte offsets, and also returns whether the text ends inside a thought.
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
    let begin = bare_final(text).unwrap_or(0);
    let (mut opened, mut stray): (Option<Tag>, usize) = (None, begin);
    for tag in tags(text).filter(|tag| tag.begin >= begin) {
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
    blank(without_end_tokens(text).len(), text.len());
    if let Some(open) = &opened {
        blank(open.begin, text.len());
    }
    // Each byte of a blanked character became a space, so the text is still valid UTF-8.
    (String::from_utf8_lossy(&shown).into_owned(), opened)
}

/// Returns the text without the tokens that end it, such as `<|im_end|>`.
fn without_end_tokens(mut text: &str) -> &str {
    let barred = |text: &str| {
        let named = text.strip_suffix("|>")?;
        let begun = named.trim_end_matches(|c: char| c.is_ascii_alphanumeric() || c == '_');
        begun.strip_suffix("<|").filter(|_| begun.len() < named.len()).map(str::len)
    };
    loop {
        let rest = text.trim_end();
        let named = || END_TOKENS.iter().find_map(|token| rest.strip_suffix(token)).map(str::len);
        match barred(rest).or_else(named) {
            Some(length) => text = &rest[..length],
            None => return text,
        }
    }
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

/// Returns where the answer begins in Harmony output that was decoded without its tokens, which leaves
/// `analysis…assistantfinal…`.
fn bare_final(text: &str) -> Option<usize> {
    const FINAL: &str = "assistantfinal";
    let is_harmony = text.trim_start().starts_with("analysis");
    is_harmony.then(|| text.rfind(FINAL)).flatten().map(|at| at + FINAL.len())
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
        for mark in END_TOKENS.into_iter().chain([
            "<|im_end|>",
            "<|channel|>",
            "<|channel|>final",
            "<",
            "◁",
            "[",
            "<|",
            "|>",
            "</think>",
            "<think>",
        ]) {
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
            ("a <think>b</think> c</think>d", ("d", false)),
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
            ("a <|b c|>", ("a <|b c|>", false)),
            ("a || b |> c", ("a || b |> c", false)),
        ] {
            assert_eq!(shown(text), (expected.0.to_owned(), expected.1), "{text}");
        }
        let text = "<think>a\nb</think>```js\n  c();\n```<think>d";
        assert_eq!(thoughts_removed(text), "\n```js\n  c();\n```<think>");
        assert_eq!(without_thoughts("<think>\n\n</think>x").0.matches('\n').count(), 2);
    }
}
