//! The prompt before an answer, as trainers send both in one text.

/// Least number of characters of a prompt's end with which a query may begin that lacks the beginning of the prompt.
const PROMPT_END_CHARS: usize = 200;

/// Returns the answer in a query, which begins with the prompt. The trainer may have cut off the beginning of a long
/// prompt, but never its end. Its tokenizer may have put special tokens before the prompt. A query that begins with
/// anything else is an answer as a whole, even if it repeats the prompt.
pub(super) fn without_prompt<'q>(query: &'q str, prompt: &str) -> &'q str {
    let pairs = [(query, prompt), (without_special_tokens(query), without_special_tokens(prompt))];
    if let Some(answer) = pairs.iter().find_map(|(query, prompt)| query.strip_prefix(prompt)) {
        return answer;
    }
    let least = prompt.char_indices().rev().nth(PROMPT_END_CHARS - 1).map_or(prompt.len(), |(at, _)| prompt.len() - at);
    let longest = |(query, prompt)| (query, shared(query, prompt));
    pairs
        .into_iter()
        .map(longest)
        .find(|(_, length)| *length >= least)
        .map_or(query, |(query, length)| &query[length..])
}

/// Removes the special tokens at the beginning of a text, such as `<s>`, and the rest of a character that was cut.
fn without_special_tokens(mut text: &str) -> &str {
    const MAX_CHARS: usize = 40;
    loop {
        text = text.trim_start_matches(|c: char| c.is_whitespace() || c == char::REPLACEMENT_CHARACTER);
        let Some((token, rest)) = text.strip_prefix('<').and_then(|text| text.split_once('>')) else { return text };
        if token.len() > MAX_CHARS || token.contains(char::is_whitespace) {
            return text;
        }
        text = rest;
    }
}

/// Returns the length in bytes of the longest beginning of `text` that is an end of `prompt`, in linear time (Knuth,
/// Morris and Pratt).
fn shared(text: &str, prompt: &str) -> usize {
    let text = &text.as_bytes()[..text.len().min(prompt.len())];
    // For each length, the longest shorter beginning of the text that is also an end of its beginning of that length.
    let mut shorter = vec![0; text.len() + 1];
    let grown = |shorter: &[usize], mut length: usize, byte: u8| {
        while length > 0 && text.get(length) != Some(&byte) {
            length = shorter[length];
        }
        length + usize::from(text.get(length) == Some(&byte))
    };
    for end in 1..text.len() {
        shorter[end + 1] = grown(&shorter, shorter[end], text[end]);
    }
    prompt.bytes().fold(0, |length, byte| grown(&shorter, length, byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prompt_is_taken_off_also_where_its_beginning_is_lost() {
        let prompt = format!("{} e.g. {{\"events\": []}} Go: ", "long ".repeat(100));
        assert_eq!(without_prompt(&format!("{prompt}I go"), &prompt), "I go");
        assert_eq!(without_prompt(&format!("{}I go", &prompt[300..]), &prompt), "I go");
        assert_eq!(without_prompt("I go", "something else"), "I go");
        assert_eq!(without_prompt("I go", ""), "I go");
        assert_eq!(without_prompt(&format!("<pad><pad><|begin_of_text|>{prompt}I go"), &prompt), "I go");
        assert_eq!(without_prompt(&format!("<s> \u{fffd}{}I go", &prompt[300..]), &prompt), "I go");
    }

    #[test]
    fn an_answer_that_repeats_the_prompt_stays_whole() {
        let prompt = format!("{} Go: ", "lòng ".repeat(100));
        let quoted = format!("As you said: {prompt}I go");
        assert_eq!(without_prompt(&quoted, &prompt), quoted);
        assert_eq!(without_prompt(&format!("{prompt}{quoted}"), &prompt), quoted);
        assert_eq!(without_prompt("Go on. Build: I go", "Build: "), "Go on. Build: I go");
        // Too short an end may be the answer's own.
        assert_eq!(without_prompt(" Go: I go", &prompt), " Go: I go");
        let dashes = "-".repeat(300);
        assert_eq!(without_prompt(&format!("{dashes}> I go"), &format!("{}{dashes}", "x".repeat(9))), "> I go");
    }
}
