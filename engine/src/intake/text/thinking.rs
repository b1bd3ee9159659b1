//! Removal of what a model's raw output holds beside its answer: its thoughts, and tokens around the message.

use std::ops::Range;

use super::marks::{ANALYSIS, Bare, CHANNEL, FINAL, LONGEST_MARK, Mark, Meaning, bare_channels, marks};
use super::template::{before_answer, message};
use crate::text::line_of;

/// Replaces thinking tags, the thoughts between them and the tokens around the message with spaces, which keeps line
/// numbers and byte offsets, and also returns whether the text ends inside a thought.
///
/// An unclosed tag extends to the end of the text. Everything before a closing tag without an opening one is a thought,
/// because some templates put the opening tag into the prompt; but not if a thought was closed before. A token that ends a
/// message ends the text, unless it stands within a thought.
#[must_use]
pub fn without_thoughts(text: &str) -> (String, bool) {
    let Blanked { shown, unclosed, .. } = blanked(text);
    (shown, unclosed.is_some())
}

/// A text whose thoughts are blank.
struct Blanked {
    shown: String,
    /// The mark of a thought that never ends.
    unclosed: Option<Mark>,
    /// The last mark that ends a thought which no mark began.
    stray: Option<Mark>,
    /// The mark that ends the message, if something follows it.
    ended: Option<Mark>,
}

fn blanked(text: &str) -> Blanked {
    let mut shown = text.as_bytes().to_vec();
    let (begin, mut opened) = match bare_channels(text) {
        None => (before_answer(text), None),
        Some(Bare::Answer(at)) => (at, None),
        Some(Bare::Thought(mark)) => (text.len(), Some(mark)),
    };
    let (mut ended, mut stray) = (None, None);
    // Everything before it is blank.
    let mut erased = begin;
    blank(&mut shown, 0..begin);
    // A thought may have held an opening tag, and then ends with the second closing one.
    let (mut is_any_closed, mut is_nested) = (false, false);
    for mark in marks(text).filter(|mark| mark.begin >= begin) {
        match (&opened, mark.meaning) {
            (None, Meaning::Opens | Meaning::OpensChannel) => {
                is_nested = false;
                opened = Some(mark);
            }
            (Some(_), Meaning::Opens) => is_nested = true,
            (Some(_), Meaning::OpensChannel | Meaning::Ends) => {}
            (Some(open), Meaning::Closes) => {
                blank(&mut shown, open.begin..mark.end);
                is_any_closed = true;
                opened = None;
            }
            (None, Meaning::Closes) if is_any_closed && !is_nested => blank(&mut shown, mark.begin..mark.end),
            (_, Meaning::Closes | Meaning::Answers) => {
                blank(&mut shown, erased..mark.end);
                erased = mark.end;
                (is_any_closed, is_nested) = (true, false);
                stray = Some(mark);
                opened = None;
            }
            (None, Meaning::Ends) => {
                ended = Some(mark);
                break;
            }
        }
    }
    if let Some(open) = &opened {
        blank(&mut shown, open.begin..text.len());
    }
    if let Some(mark) = &ended {
        blank(&mut shown, mark.begin..text.len());
    }
    let ended = ended.filter(|mark| !text[mark.end..].trim().is_empty());
    // Each byte of a blanked character became a space, so the text is still valid UTF-8.
    let shown = String::from_utf8(shown).expect("whole characters are blanked");
    Blanked { shown: without_tokens_around(shown), unclosed: opened, stray, ended }
}

/// Replaces the tokens around the message with spaces.
fn without_tokens_around(shown: String) -> String {
    let message = message(&shown);
    if message == (0..shown.len()) {
        return shown;
    }
    let mut bytes = shown.into_bytes();
    let length = bytes.len();
    blank(&mut bytes, 0..message.start);
    blank(&mut bytes, message.end..length);
    String::from_utf8(bytes).expect("whole characters are blanked")
}

/// Replaces what is no line break with spaces.
fn blank(bytes: &mut [u8], range: Range<usize>) {
    for byte in &mut bytes[range] {
        if *byte != b'\n' {
            *byte = b' ';
        }
    }
}

/// Explains why a text was not read to its end, or not from its beginning: a thought that is never closed, the tag that
/// ends a thought which none began, or the token that ends the message. None if only thoughts with both tags were left
/// out.
#[must_use]
pub fn left_out(text: &str) -> Option<String> {
    let Blanked { shown, unclosed, stray, ended } = blanked(text);
    let named = |mark: Mark| format!("{} in line {}", &text[mark.begin..mark.end], line_of(text, mark.begin));
    if let Some(open) = unclosed.filter(|open| open.meaning == Meaning::OpensChannel) {
        let is_call = text[open.begin..].contains(" to=");
        let call = if is_call { "; what a tool call says is not read" } else { "" };
        return Some(format!("the answer has no message in the channel `final`, only {}{call}", named(open)));
    }
    if let Some(open) = unclosed {
        return Some(format!("the answer ends inside a thinking tag that is never closed: {}", named(open)));
    }
    if let Some(close) = stray {
        let follows = if shown.trim().is_empty() { ", and no answer follows" } else { "" };
        return Some(format!("everything before {} was taken for thoughts{follows}", named(close)));
    }
    ended.map(|end| format!("everything after {} was left out", named(end)))
}

/// Returns the opening tag at the end of a prompt, which the answer to it goes on from.
#[must_use]
pub fn opened_at_the_end(prompt: &str) -> Option<&str> {
    let prompt = prompt.trim_end();
    let end = &prompt[prompt.ceil_char_boundary(prompt.len().saturating_sub(LONGEST_MARK))..];
    let last = marks(end).last().filter(|mark| mark.opens() && mark.end == end.len())?;
    Some(&end[last.begin..])
}

/// Returns an answer with the opening tag of its prompt before it. If decoding left the tokens of Harmony out of the answer,
/// they are left out of the tag too.
#[must_use]
pub fn with_opening(opened: &str, answer: &str) -> String {
    let is_bare = opened.starts_with(CHANNEL) && answer.contains(FINAL) && !answer.contains(CHANNEL);
    format!("{}{answer}", if is_bare { ANALYSIS } else { opened })
}

/// Returns whether a text begins with a thought.
#[must_use]
pub fn begins_with_thought(text: &str) -> bool {
    let begin = text.len() - text.trim_start().len();
    marks(text).next().is_some_and(|mark| mark.begin == begin && mark.opens())
}

/// Removes thinking tags and the thoughts between them. Lines keep their numbers; what is left of a line with a thought
/// loses the spaces around it. A tag that is never closed stays, so that whoever reads the rest can tell.
#[must_use]
pub fn thoughts_removed(text: &str) -> String {
    let Blanked { shown, unclosed, .. } = blanked(text);
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
        for mark in [
            "<think><think></think></think>",
            "<|channel|>final<|message|>a<think>",
            "</think><think>a",
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
            "<|im_start|>assistant",
            "<|im_start|>assistant\n<|im_end|>",
        ] {
            for before in ["a ", "", "<|im_start|>user"] {
                let text = format!("{before}{}", mark.repeat(MARKS));
                assert_eq!(without_thoughts(&text).0.len(), text.len());
            }
        }
        let long = format!("<|channel|>analysis{}", "é".repeat(200));
        assert_eq!(shown(&long), (String::new(), true));
    }

    #[test]
    fn a_prompt_that_is_still_there_is_left_out() {
        for text in [
            "<s>[INST] a [/INST] b</s>",
            "<s>[SYSTEM_PROMPT]s[/SYSTEM_PROMPT][INST]a[/INST][THINK]t[/THINK]b</s>",
            "<｜begin▁of▁sentence｜>s<｜User｜>a<｜Assistant｜><think>\nt</think>\nb<｜end▁of▁sentence｜>",
            "<|header_start|>user<|header_end|>\n\na<|eot|><|header_start|>assistant<|header_end|>\n\nb<|eot|>",
            "<BOS_TOKEN><|START_OF_TURN_TOKEN|><|USER_TOKEN|>a<|END_OF_TURN_TOKEN|><|START_OF_TURN_TOKEN|><|CHATBOT_TOKEN|>b<|END_OF_TURN_TOKEN|>",
            "<|system|>s<|end|><|user|>a<|end|><|assistant|>b<|end|>",
            "[gMASK]<sop><|user|>\na<|assistant|>\n<think>t</think>\nb<|user|>",
            "[|system|]s[|endofturn|]\n[|user|]a\n[|assistant|]b[|endofturn|]",
            "<|im_user|>user<|im_middle|>a<|im_end|><|im_assistant|>assistant<|im_middle|>b<|im_end|>",
            "<|start_of_role|>user<|end_of_role|>a<|end_of_text|>\n<|start_of_role|>assistant<|end_of_role|>b<|end_of_text|>",
        ] {
            assert_eq!(shown(text), ("b".to_owned(), false), "{text}");
        }
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
            ("a<|im_end|>\n<|im_start|>assistant\nb</think>c", ("a", false)),
            ("a<|im_end|><think>", ("a", false)),
            ("<think>a<|im_end|></think>b", ("b", false)),
            (
                "<|start|>assistant<|channel|>analysis<|message|>a<|end|><|start|>assistant<|channel|>final<|message|>b",
                ("b", false),
            ),
            ("<think>a</think>b<|START_RESPONSE|>c", ("c", false)),
            (
                "<|im_start|>system\na<|im_end|>\n<|im_start|>user\nb<|im_end|>\n<|im_start|>assistant\nc<|im_end|>",
                ("c", false),
            ),
            ("<|endoftext|>b", ("b", false)),
            ("<|eot_id|> <|eot_id|>\n<think>a</think>b", ("b", false)),
            ("<|endoftext|><|im_start|>assistant\nb<|endoftext|>c", ("b", false)),
            ("<pad><pad><bos><start_of_turn>user\na<end_of_turn>\n<start_of_turn>model\nb<end_of_turn>", ("b", false)),
            ("<|endoftext|><|endoftext|><|im_start|>user\na<|im_end|>\n<|im_start|>assistant\nb", ("b", false)),
            (
                "<|im_start|>user\na<|im_end|>\n<|im_start|>assistant\nb<|im_end|>\n<|im_start|>assistant\n",
                ("b", false),
            ),
            ("<|im_start|>user\na<|im_end|>\n<|im_start|>assistant\n<|im_end|>", ("", false)),
            (
                "<|im_start|>user\na<|im_end|>\n<|im_start|>assistant\nb<|im_end|>\n<|im_start|>assistant\n<think>\n\n</think>\n<|im_end|>",
                ("b", false),
            ),
            ("analysisWe need to build.", ("", true)),
            ("analysis: b", ("analysis: b", false)),
        ] {
            assert_eq!(shown(text), (expected.0.to_owned(), expected.1), "{text}");
        }
        for (text, why) in [
            ("a\n<Thinking>b", "the answer ends inside a thinking tag that is never closed: <Thinking> in line 2"),
            ("a\n\nb [/THINK] ", "everything before [/THINK] in line 3 was taken for thoughts, and no answer follows"),
            ("a</think>b", "everything before </think> in line 1 was taken for thoughts"),
            (
                "<|channel|>analysis<|message|>a<|end|><|start|>assistant<|channel|>commentary to=f <|message|>{}<|call|>",
                "the answer has no message in the channel `final`, only <|channel|>analysis<|message|> in line 1; what a tool call says is not read",
            ),
            ("analysisWe plan.", "the answer has no message in the channel `final`, only analysis in line 1"),
            ("a\n<|im_end|>\nb", "everything after <|im_end|> in line 2 was left out"),
        ] {
            assert_eq!(left_out(text).as_deref(), Some(why));
        }
        assert_eq!(left_out("<think>a</think>b<|im_end|>\n"), None);
        assert_eq!(opened_at_the_end("user: build\nassistant: <think>\n"), Some("<think>"));
        assert_eq!(opened_at_the_end("é<think>plan</think>"), None);
        let channel = "<|channel|>analysis<|message|>";
        assert_eq!(opened_at_the_end(&format!("{}<|start|>assistant{channel}", "é".repeat(500))), Some(channel));
        assert_eq!(opened_at_the_end("<|start|>assistant<|channel|>final<|message|>"), None);
        assert_eq!(shown(&with_opening(channel, "We plan.assistantfinalb")), ("b".to_owned(), false));
        assert_eq!(shown(&with_opening(channel, "We plan.")), (String::new(), true));
        assert_eq!(opened_at_the_end("<think> a"), None);
        assert_eq!(opened_at_the_end("<start_of_turn>model\n<|channel>thought\n"), Some("<|channel>thought"));
        assert!(
            begins_with_thought(" [THINK]a") && !begins_with_thought("a <think>") && !begins_with_thought("</think>")
        );
        let text = "<think>a\nb</think>```js\n  c();\n```<think>d";
        assert_eq!(thoughts_removed(text), "\n```js\n  c();\n```<think>");
        assert_eq!(without_thoughts("<think>\n\n</think>x").0.matches('\n').count(), 2);
    }
}
