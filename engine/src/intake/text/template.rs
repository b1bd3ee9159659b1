//! Tokens that a chat template puts around a message, as raw output has them.

/// Tokens after which a message is over, whatever the model went on to write.
pub const ENDS: [&str; 10] = [
    "<|im_end|>",
    "<|eot_id|>",
    "<|eom_id|>",
    "<|end_of_text|>",
    "<|endoftext|>",
    "<|return|>",
    "<|END_RESPONSE|>",
    "<｜end▁of▁sentence｜>",
    "<end_of_turn>",
    "[|endofturn|]",
];

/// Further tokens that are left out at the end of a text, beside all of the form `<|name|>`. Within a text they may be part
/// of code.
const LAST: [&str; 10] =
    ["</s>", "<turn|>", "<eos>", "<eom>", "<eot>", "<pad>", "<seed:eos>", "</longcat_s>", "[e~[", "<SPECIAL_12>"];

/// Tokens without bars that begin a message.
const BEGINNINGS: [&str; 2] = ["<start_of_turn>", "<s>"];

/// Names of the sender between the tokens that begin a message.
const ROLES: [&str; 2] = ["assistant", "model"];

/// Heads of the messages of a prompt, with the head of the answer to it.
const PROMPTS: [(&[&str], &str); 11] = [
    (&["<|im_start|>system", "<|im_start|>user"], "<|im_start|>assistant"),
    (&["<|start_header_id|>system", "<|start_header_id|>user"], "<|start_header_id|>assistant<|end_header_id|>"),
    (&["<start_of_turn>user"], "<start_of_turn>model"),
    // Llama 4.
    (&["<|header_start|>system", "<|header_start|>user"], "<|header_start|>assistant<|header_end|>"),
    // Mistral, and Llama 2.
    (&["[INST]", "[SYSTEM_PROMPT]"], "[/INST]"),
    // DeepSeek.
    (&["<｜begin▁of▁sentence｜>", "<｜User｜>"], "<｜Assistant｜>"),
    // Cohere.
    (
        &["<|START_OF_TURN_TOKEN|><|SYSTEM_TOKEN|>", "<|START_OF_TURN_TOKEN|><|USER_TOKEN|>"],
        "<|START_OF_TURN_TOKEN|><|CHATBOT_TOKEN|>",
    ),
    // Phi, GLM, OLMo.
    (&["<|system|>", "<|user|>"], "<|assistant|>"),
    // EXAONE.
    (&["[|system|]", "[|user|]"], "[|assistant|]"),
    // Kimi.
    (&["<|im_system|>", "<|im_user|>"], "<|im_assistant|>assistant<|im_middle|>"),
    // Granite.
    (&["<|start_of_role|>system", "<|start_of_role|>user"], "<|start_of_role|>assistant<|end_of_role|>"),
];

/// Tokens that begin a whole conversation.
const CONVERSATIONS: [&str; 7] =
    ["<|begin_of_text|>", "<bos>", "<s>", "<BOS_TOKEN>", "<|startoftext|>", "[gMASK]", "<sop>"];

/// Returns where the answer begins: after the padding, and in a text that still has its prompt after the head of the last
/// message that is not empty.
#[must_use]
pub fn before_answer(text: &str) -> usize {
    let padding = padding(text);
    let padded = &text[padding..];
    let of_prompt = PROMPTS.iter().find(|(heads, _)| heads.iter().any(|head| padded.starts_with(head)));
    let Some((_, head)) = of_prompt else { return padding };
    // A model that goes on after its message may begin another.
    let is_empty = |message: &str| {
        let message = message.trim_start();
        // Some models do not think between the tags.
        let thought = message.strip_prefix("<think>").and_then(|rest| rest.trim_start().strip_prefix("</think>"));
        let message = thought.unwrap_or(message).trim_start();
        message.is_empty() || message.starts_with(head) || ENDS.iter().any(|token| message.starts_with(token))
    };
    let mut messages = text.rmatch_indices(head).map(|(at, _)| at + head.len());
    let last = messages.next();
    let is_answer = |at: &usize| !is_empty(&text[*at..]);
    last.into_iter().chain(messages).find(is_answer).or(last).unwrap_or(padding)
}

/// Returns the length of the tokens and the white space before a conversation or message: a tokenizer may begin every text
/// with the token that ends one, or pad with it.
fn padding(text: &str) -> usize {
    let mut rest = text;
    loop {
        let next = rest.trim_start();
        let mut tokens = CONVERSATIONS.iter().chain(&ENDS).chain(&LAST);
        match tokens.find_map(|token| next.strip_prefix(token)) {
            Some(after) => rest = after,
            None => return text.len() - next.len(),
        }
    }
}

/// Returns where the message in a text begins and ends, without the tokens around it.
#[must_use]
pub fn message(text: &str) -> std::ops::Range<usize> {
    let end = without_last_tokens(text).len();
    beginning(&text[..end])..end
}

/// Returns the length of the tokens that begin a message, with the name of its sender.
fn beginning(text: &str) -> usize {
    let mut rest = text;
    loop {
        let next = rest.trim_start();
        let token = BEGINNINGS.iter().find_map(|token| next.strip_prefix(token)).or_else(|| after_barred(next));
        let Some(after) = token else { return text.len() - rest.len() };
        let role = ROLES.iter().find_map(|role| after.strip_prefix(role));
        rest = role.filter(|rest| rest.is_empty() || rest.starts_with(['<', '\n', ' '])).unwrap_or(after);
    }
}

/// Returns what follows the token `<|name|>` at the beginning of a text.
fn after_barred(text: &str) -> Option<&str> {
    let named = text.strip_prefix("<|")?;
    let after = named.trim_start_matches(is_of_name);
    after.strip_prefix("|>").filter(|_| after.len() < named.len())
}

/// Returns the text without the tokens that end it.
fn without_last_tokens(mut text: &str) -> &str {
    let barred = |text: &str| {
        let named = text.strip_suffix("|>")?;
        let begun = named.trim_end_matches(is_of_name);
        begun.strip_suffix("<|").filter(|_| begun.len() < named.len()).map(str::len)
    };
    loop {
        let rest = text.trim_end();
        let known = || LAST.iter().chain(&ENDS).find_map(|token| rest.strip_suffix(token)).map(str::len);
        match barred(rest).or_else(known) {
            Some(length) => text = &rest[..length],
            None => return text,
        }
    }
}

fn is_of_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of tokens that a text of nothing else has.
    const MARKS: usize = 300_000;

    #[test]
    fn tokens_around_a_message_are_no_part_of_it() {
        for (text, expected) in [
            ("a // <|im_end|>\nb<|im_end|>\n", "a // <|im_end|>\nb"),
            ("a</s><|eot_id|>", "a"),
            ("a</s> b", "a</s> b"),
            ("a<｜end▁of▁sentence｜>", "a"),
            ("a<end_of_turn>\n<pad><pad>", "a"),
            ("a<eos>\n", "a"),
            ("a <|b c|>", "a <|b c|>"),
            ("a || b |> c", "a || b |> c"),
            ("|>", "|>"),
            ("<|start_header_id|>assistant<|end_header_id|>\n\na", "\n\na"),
            ("<|im_start|>assistant\na", "\na"),
            ("<start_of_turn>model\na<end_of_turn>", "\na"),
            ("<|im_start|>assistants a", "assistants a"),
            ("assistant\na", "assistant\na"),
        ] {
            assert_eq!(&text[message(text)], expected, "{text}");
        }
        for token in ENDS.into_iter().chain(LAST).chain(BEGINNINGS).chain(["<|a|>", "<|", "|>", "<"]) {
            for text in [token.repeat(MARKS), format!("a {}", token.repeat(MARKS))] {
                assert!(message(&text).end <= text.len());
            }
        }
    }
}
