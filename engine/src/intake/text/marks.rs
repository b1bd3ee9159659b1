//! Marks in a model's raw output that say what is thought and what is answer: tags, and tokens of model families.

use super::template::ENDS;

/// Names of the tags that enclose thoughts, as in `<think>` and `</think>`, in any letter case.
const TAGS: [&str; 7] = ["think", "thinking", "thought", "reasoning", "scratchpad", "seed:think", "longcat_think"];

/// Length in bytes of the longest tag name.
const LONGEST: usize = 13;

/// Tokens that enclose thoughts in the raw output of a family of models: the opening one and the closing one.
const TOKENS: [(&str, &str); 7] = [
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
    ("<|channel>thought", "<channel|>"),
    ("<|channel>", "<channel|>"),
];

/// Tokens that begin the answer, so that everything before them is thought.
const ANSWERS: [&str; 1] = [
    // Cohere.
    "<|START_RESPONSE|>",
];

/// Token of gpt-oss (the Harmony format) that begins the name of a channel. The answer is in the channel `final`.
pub const CHANNEL: &str = "<|channel|>";
/// What is left of the head of the thoughts where Harmony was decoded without its tokens.
pub const ANALYSIS: &str = "analysis";
/// What is then left of the end of the thoughts and the head of the answer.
pub const FINAL: &str = "assistantfinal";
/// Token of Harmony between the head of a message and its text.
const MESSAGE: &str = "<|message|>";
/// Most bytes of the head of a Harmony message, which may name a recipient and a format.
const LONGEST_HEAD: usize = 200;

/// Most bytes of a mark.
pub const LONGEST_MARK: usize = CHANNEL.len() + LONGEST_HEAD;

/// What a mark means for what stands around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// A thought begins.
    Opens,
    /// A thought begins in a channel of Harmony, whose messages are not nested.
    OpensChannel,
    /// A thought ends.
    Closes,
    /// The answer begins: everything before is thought.
    Answers,
    /// The message ends, unless this is within a thought.
    Ends,
}

/// A mark and its place in the text, in bytes.
#[derive(Debug, Clone, Copy)]
pub struct Mark {
    /// Begin of the mark.
    pub begin: usize,
    /// End of the mark.
    pub end: usize,
    /// What it means.
    pub meaning: Meaning,
}

impl Mark {
    /// Returns whether a thought begins here.
    #[must_use]
    pub fn opens(&self) -> bool {
        matches!(self.meaning, Meaning::Opens | Meaning::OpensChannel)
    }
}

/// Returns the marks of a text, in order.
pub fn marks(text: &str) -> impl Iterator<Item = Mark> {
    text.match_indices(['<', '[', '◁']).filter_map(|(begin, _)| {
        let rest = &text[begin..];
        let (length, meaning) = named(rest).or_else(|| token(rest)).or_else(|| channel(rest))?;
        Some(Mark { begin, end: begin + length, meaning })
    })
}

/// Returns the length of the tag of [`TAGS`] that a text begins with, and what it means.
fn named(text: &str) -> Option<(usize, Meaning)> {
    let rest = text.strip_prefix('<')?;
    let (meaning, name) = rest.strip_prefix('/').map_or((Meaning::Opens, rest), |name| (Meaning::Closes, name));
    let length = name.bytes().take(LONGEST + 1).position(|byte| byte == b'>')?;
    let is_one = TAGS.iter().any(|tag| name[..length].eq_ignore_ascii_case(tag));
    is_one.then(|| (text.len() - name.len() + length + 1, meaning))
}

/// Returns the length of the token that a text begins with, and what it means.
fn token(text: &str) -> Option<(usize, Meaning)> {
    let opening = TOKENS.iter().map(|(opening, _)| (*opening, Meaning::Opens));
    let closing = TOKENS.iter().map(|(_, closing)| (*closing, Meaning::Closes));
    let others = ANSWERS.map(|token| (token, Meaning::Answers)).into_iter();
    let mut tokens = opening.chain(closing).chain(others).chain(ENDS.map(|token| (token, Meaning::Ends)));
    tokens.find_map(|(token, meaning)| text.starts_with(token).then_some((token.len(), meaning)))
}

/// Returns the length of the head of a Harmony message that a text begins with, and what it means: the answer begins in the
/// channel `final`.
fn channel(text: &str) -> Option<(usize, Meaning)> {
    let name = text.strip_prefix(CHANNEL)?;
    let is_final = name.starts_with("final");
    let head = name[..name.floor_char_boundary(LONGEST_HEAD)].find(MESSAGE);
    let length = head.map_or(if is_final { "final".len() } else { 0 }, |length| length + MESSAGE.len());
    Some((CHANNEL.len() + length, if is_final { Meaning::Answers } else { Meaning::OpensChannel }))
}

/// Harmony output that was decoded without its tokens, which leaves `analysis…assistantfinal…`.
#[derive(Debug)]
pub enum Bare {
    /// The answer begins here.
    Answer(usize),
    /// The output ends in the thoughts, which begin with this tag.
    Thought(Mark),
}

/// Returns what a text is if it is Harmony output that was decoded without its tokens.
#[must_use]
pub fn bare_channels(text: &str) -> Option<Bare> {
    let begin = text.len() - text.trim_start().len();
    let thought = text[begin..].strip_prefix(ANALYSIS)?;
    if let Some(at) = text.rfind(FINAL) {
        return Some(Bare::Answer(at + FINAL.len()));
    }
    // The first word of the thoughts follows without a space, with a letter that is not a small one.
    let is_thought = thought.chars().next().is_some_and(|c| c.is_alphabetic() && !c.is_lowercase());
    is_thought.then(|| Bare::Thought(Mark { begin, end: begin + ANALYSIS.len(), meaning: Meaning::OpensChannel }))
}
