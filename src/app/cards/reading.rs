//! Reading a card, with every fault at its place.

use serde_json::{Map, Value};
use sha2::{Digest as _, Sha256};

use super::card::{Card, SystemPrompt};
use crate::app::limits::LIMITS;
use crate::clock::day_ms;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::hex;
use plumbline_engine::text::did_you_mean;

/// What a member of a card may be.
#[derive(Debug, Clone, Copy)]
enum Member {
    /// Text of 1 to this number of characters.
    Text(usize),
    /// Finite number from the first to the second.
    Number(f64, f64),
    /// Number greater than 0.
    Amount,
    /// Whole number from 0.
    Count,
    /// Whole number.
    Whole,
    /// SHA-256 in hex.
    Sha256,
    /// Text of at most `card_prompt_bytes`.
    Prompt,
    /// One of these words.
    Word(&'static [&'static str]),
    /// Three capital letters.
    Currency,
    /// Day of the calendar.
    Day,
    /// Address of a page.
    Url,
    /// Object with these members; those marked `true` must be there.
    Object(&'static [(&'static str, Member, bool)]),
    /// List of such objects, at most this number of them.
    List(usize, &'static [(&'static str, Member, bool)]),
}

const NAME: Member = Member::Text(200);
const HARNESS: &[(&str, Member, bool)] = &[("name", NAME, false), ("version", NAME, false)];
const MODEL: &[(&str, Member, bool)] = &[
    ("name", NAME, false),
    ("revision", NAME, false),
    ("openness", Member::Word(&["open-source", "open-weights", "closed"]), false),
];
const PROMPT: &[(&str, Member, bool)] = &[("sha256", Member::Sha256, false), ("text", Member::Prompt, false)];
const SAMPLING: &[(&str, Member, bool)] = &[
    ("temperature", Member::Number(0.0, 100.0), false),
    ("top_p", Member::Number(0.0, 1.0), false),
    ("max_tokens", Member::Count, false),
    ("seed", Member::Whole, false),
    ("reasoning_effort", NAME, false),
];
const TOKENS: &[(&str, Member, bool)] = &[
    ("input", Member::Count, false),
    ("output", Member::Count, false),
    ("cached_input", Member::Count, false),
    ("reasoning", Member::Count, false),
];
const COST: &[(&str, Member, bool)] =
    &[("amount", Member::Amount, true), ("currency", Member::Currency, true), ("prices_as_of", Member::Day, true)];
const LINK: &[(&str, Member, bool)] = &[("title", NAME, true), ("url", Member::Url, true)];
const CARD: &[(&str, Member, bool)] = &[
    ("agent_version", NAME, false),
    ("harness", Member::Object(HARNESS), false),
    ("model", Member::Object(MODEL), false),
    ("system_prompt", Member::Object(PROMPT), false),
    ("sampling", Member::Object(SAMPLING), false),
    ("tokens", Member::Object(TOKENS), false),
    ("cost", Member::Object(COST), false),
    ("configuration_sha256", Member::Sha256, false),
    ("links", Member::List(10, LINK), false),
];

/// Reads a card, and adds all its faults.
pub fn read_card(value: &Value, faults: &mut Faults) -> Option<Card> {
    let told = faults.total();
    let read = Member::Object(CARD).read(value, faults);
    if faults.total() > told {
        return None;
    }
    let mut card: Card = serde_json::from_value(read?).expect("every member was read as the card has it");
    if let Some(SystemPrompt { sha256, text: Some(text) }) = &mut card.system_prompt {
        let found = hex(&Sha256::digest(text.as_bytes()));
        if sha256.as_ref().is_some_and(|given| *given != found) {
            faults.enter_key("system_prompt");
            faults.add_at("sha256", format!("the text has the SHA-256 {found}"));
            faults.leave();
            return None;
        }
        *sha256 = Some(found);
    }
    Some(card)
}

impl Member {
    /// Reads a value; members that are null count as absent.
    fn read(self, value: &Value, faults: &mut Faults) -> Option<Value> {
        match self {
            Self::Object(members) => read_object(members, value, faults),
            Self::List(most, members) => read_list(most, members, value, faults),
            _ => match self.fault_of(value) {
                None => Some(if matches!(self, Self::Sha256) { lowercase(value) } else { value.clone() }),
                Some(fault) => {
                    faults.add(fault);
                    None
                }
            },
        }
    }

    /// Describes what is wrong with a value that is neither an object nor a list.
    fn fault_of(self, value: &Value) -> Option<String> {
        let text = value.as_str();
        let (is_right, wanted) = match self {
            Self::Text(most) => {
                let is_right = text.is_some_and(|text| {
                    !text.trim().is_empty() && text.chars().count() <= most && !text.contains('\0')
                });
                (is_right, format!("1 to {most} characters of text, without U+0000"))
            }
            Self::Number(least, most) => {
                (value.as_f64().is_some_and(|number| (least..=most).contains(&number)), format!("{least} to {most}"))
            }
            Self::Amount => {
                let is_right = value.as_f64().is_some_and(|amount| amount > 0.0 && amount < 1e12);
                (is_right, "a number greater than 0; leave the cost out where it is unknown".to_owned())
            }
            Self::Count => (value.as_u64().is_some_and(|count| count < 1 << 53), "a whole number from 0".to_owned()),
            Self::Whole => (value.as_i64().is_some(), "a whole number".to_owned()),
            Self::Sha256 => {
                let is_hex = |text: &str| text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
                (text.is_some_and(is_hex), "64 hexadecimal digits".to_owned())
            }
            Self::Prompt => {
                let most = LIMITS.card_prompt_bytes;
                let is_right = text.is_some_and(|text| text.len() <= most && !text.contains('\0'));
                (is_right, format!("text of at most {most} bytes, without U+0000"))
            }
            Self::Word(words) => {
                (text.is_some_and(|text| words.contains(&text)), format!("one of {}", words.join(", ")))
            }
            Self::Currency => {
                let is_code = |text: &str| text.len() == 3 && text.bytes().all(|byte| byte.is_ascii_uppercase());
                (text.is_some_and(is_code), "a currency of ISO 4217, such as USD".to_owned())
            }
            Self::Day => (text.is_some_and(|text| day_ms(text).is_some()), "a date as YYYY-MM-DD".to_owned()),
            Self::Url => {
                let is_url = |text: &str| {
                    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
                    text.len() <= 2_000
                        && rest.is_some_and(|rest| !rest.is_empty() && !rest.starts_with('/'))
                        && !text.chars().any(|c| c.is_whitespace() || c.is_control() || "<>\"\\^`{|}".contains(c))
                };
                (text.is_some_and(is_url), "an address with http or https".to_owned())
            }
            Self::Object(_) | Self::List(..) => return None,
        };
        (!is_right).then(|| format!("expected {wanted}"))
    }
}

fn lowercase(value: &Value) -> Value {
    value.as_str().map(str::to_ascii_lowercase).into()
}

fn read_object(members: &[(&str, Member, bool)], value: &Value, faults: &mut Faults) -> Option<Value> {
    let Some(object) = value.as_object() else {
        faults.add("expected an object");
        return None;
    };
    for key in object.keys().filter(|key| !members.iter().any(|(name, ..)| name == key)) {
        let meant = did_you_mean(key, members.iter().map(|(name, ..)| *name));
        faults.add_at(key, format!("unknown field{meant}"));
    }
    let mut read = Map::new();
    for (name, member, must_be_there) in members {
        match object.get(*name).filter(|value| !value.is_null()) {
            Some(value) => {
                faults.enter_key(name);
                read.extend(member.read(value, faults).map(|value| ((*name).to_owned(), value)));
                faults.leave();
            }
            None if *must_be_there => faults.add_at(name, "missing"),
            None => {}
        }
    }
    Some(Value::Object(read))
}

fn read_list(most: usize, members: &[(&str, Member, bool)], value: &Value, faults: &mut Faults) -> Option<Value> {
    let Some(items) = value.as_array() else {
        faults.add("expected an array");
        return None;
    };
    if items.len() > most {
        faults.add(format!("{} items; at most {most} are allowed", items.len()));
        return None;
    }
    let mut read = Vec::new();
    for (index, item) in items.iter().enumerate() {
        faults.enter_index(index);
        read.extend(read_object(members, item, faults));
        faults.leave();
    }
    Some(Value::Array(read))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn faults_of(value: &Value) -> Vec<String> {
        let mut faults = Faults::new();
        assert_eq!(read_card(value, &mut faults).is_none(), !faults.is_empty());
        faults.list().iter().map(ToString::to_string).collect()
    }

    #[test]
    fn every_fault_has_its_place() {
        let faulty = json!({
            "modle": {}, "model": { "openness": "half" }, "tokens": { "input": -1, "output": 1.5 }, "harness": "x",
            "cost": { "amount": 0, "currency": "usd", "prices_as_of": "2026-13-01" },
            "links": [{ "title": "t", "url": "javascript:alert(1)" }, { "url": "https://x" }],
            "system_prompt": { "text": "a", "sha256": "00" },
        });
        assert_eq!(
            faults_of(&faulty),
            [
                "/modle: unknown field; did you mean model?",
                "/harness: expected an object",
                "/model/openness: expected one of open-source, open-weights, closed",
                "/system_prompt/sha256: expected 64 hexadecimal digits",
                "/tokens/input: expected a whole number from 0",
                "/tokens/output: expected a whole number from 0",
                "/cost/amount: expected a number greater than 0; leave the cost out where it is unknown",
                "/cost/currency: expected a currency of ISO 4217, such as USD",
                "/cost/prices_as_of: expected a date as YYYY-MM-DD",
                "/links/0/url: expected an address with http or https",
                "/links/1/title: missing",
            ]
        );
        assert_eq!(faults_of(&json!([])), ["expected an object"]);
    }

    #[test]
    fn what_is_null_is_left_out_and_a_prompt_gets_its_hash() {
        let mut faults = Faults::new();
        let given =
            json!({ "cost": null, "tokens": { "input": 7, "output": null }, "system_prompt": { "text": "abc" } });
        let card = read_card(&given, &mut faults).unwrap();
        let hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let expected = json!({ "tokens": { "input": 7 }, "system_prompt": { "sha256": hash, "text": "abc" } });
        assert_eq!(serde_json::to_value(&card).unwrap(), expected);
        let other = json!({ "system_prompt": { "text": "abcd", "sha256": hash } });
        assert!(faults_of(&other)[0].starts_with("/system_prompt/sha256: the text has the SHA-256 "));
    }
}
