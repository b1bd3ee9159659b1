//! Types of the OpenAPI document, as pages show them.

use askama::Template;
use serde_json::Value;

use super::prose;

/// A type in words, with the schemas that it names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Kind<'d>(pub Vec<Word<'d>>);

/// Part of a type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Word<'d> {
    /// Words.
    Text(String),
    /// A schema that has a page.
    Schema(&'d str),
}

/// A member of an object.
pub struct Member<'d> {
    /// Name.
    pub name: &'d str,
    /// Type.
    pub kind: Kind<'d>,
    /// Whether it must be there, or always is.
    pub is_required: bool,
    /// Description as markup.
    pub about: String,
}

/// Page of a schema.
#[derive(Template)]
#[template(path = "reference/schema.html")]
pub struct SchemaPage<'d> {
    name: &'d str,
    about: String,
    kind: Kind<'d>,
    members: Vec<Member<'d>>,
    values: Vec<String>,
    example: Option<String>,
}

impl<'d> SchemaPage<'d> {
    /// Builds the page of a schema.
    pub fn of(name: &'d str, schema: &'d Value, document: &'d Value) -> Self {
        let example = schema.get("example");
        let values = schema["enum"].as_array().into_iter().flatten().map(plain);
        Self {
            name,
            about: prose(text(schema, "description")),
            kind: kind_of(schema),
            members: members_of(schema, document),
            values: values.collect(),
            example: example.map(|example| serde_json::to_string_pretty(example).expect("a value is JSON")),
        }
    }
}

/// Returns the members of an object, also of one that adds to another.
pub fn members_of<'d>(schema: &'d Value, document: &'d Value) -> Vec<Member<'d>> {
    let of_parts = schema["allOf"].as_array().into_iter().flatten().flat_map(|part| {
        let named = part.get("$ref").and_then(Value::as_str).and_then(|name| document.pointer(name.strip_prefix('#')?));
        members_of(named.unwrap_or(part), document)
    });
    let required = |name: &str| schema["required"].as_array().is_some_and(|all| all.iter().any(|own| own == name));
    let own = schema["properties"].as_object().into_iter().flatten().map(|(name, member)| Member {
        name,
        kind: kind_of(member),
        is_required: required(name),
        about: about(member, document),
    });
    of_parts.chain(own).collect()
}

/// Returns the description of a member, or of the only schema that it names.
fn about(member: &Value, document: &Value) -> String {
    let own = text(member, "description");
    if !own.is_empty() {
        return prose(own);
    }
    let named = kind_of(member).0.into_iter().filter_map(|word| match word {
        Word::Schema(name) => Some(text(&document["components"]["schemas"][name], "description")),
        Word::Text(_) => None,
    });
    prose(named.into_iter().next_back().unwrap_or_default())
}

/// Describes a type.
pub fn kind_of(schema: &Value) -> Kind<'_> {
    let mut words = Vec::new();
    describe(schema, &mut words);
    Kind(words)
}

fn describe<'d>(schema: &'d Value, words: &mut Vec<Word<'d>>) {
    let say = |words: &mut Vec<Word<'d>>, text: &str| words.push(Word::Text(text.to_owned()));
    if let Some(name) = schema.get("$ref").and_then(Value::as_str) {
        words.push(Word::Schema(name.rsplit('/').next().unwrap_or_default()));
        return;
    }
    if let Some(choices) = schema["oneOf"].as_array().or_else(|| schema["anyOf"].as_array()) {
        for (i, choice) in choices.iter().enumerate() {
            if i > 0 {
                say(words, " or ");
            }
            describe(choice, words);
        }
        return;
    }
    if let Some(values) = schema["enum"].as_array() {
        say(words, &values.iter().map(plain).collect::<Vec<_>>().join(", "));
        return;
    }
    let types: Vec<&str> = match &schema["type"] {
        Value::String(one) => vec![one],
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect(),
        _ if schema.get("properties").is_some() || schema.get("allOf").is_some() => vec!["object"],
        _ => vec!["any value"],
    };
    for (i, one) in types.iter().enumerate() {
        if i > 0 {
            say(words, " or ");
        }
        match *one {
            "array" => {
                say(words, "array of ");
                describe(&schema["items"], words);
            }
            "object" if schema["additionalProperties"].is_object() => {
                say(words, "object of ");
                describe(&schema["additionalProperties"], words);
            }
            other => say(words, other),
        }
    }
    let bounds = bounds(schema);
    if !bounds.is_empty() {
        say(words, &format!(" ({bounds})"));
    }
}

/// Tells the bounds of values in words.
fn bounds(schema: &Value) -> String {
    let number = |name: &str| schema.get(name).map(plain);
    let range = |low: Option<String>, high: Option<String>, unit: &str| match (low, high) {
        (Some(low), Some(high)) => Some(format!("{low} to {high}{unit}")),
        (Some(low), None) => Some(format!("at least {low}{unit}")),
        (None, Some(high)) => Some(format!("at most {high}{unit}")),
        (None, None) => None,
    };
    let format = schema["format"].as_str().filter(|format| !format.starts_with("int") && *format != "double");
    let parts = [
        format.map(|format| format.replace('-', " ")),
        range(number("minimum"), number("maximum"), ""),
        range(number("minLength"), number("maxLength"), " characters"),
        range(number("minItems"), number("maxItems"), " items"),
        schema["pattern"].as_str().map(|pattern| format!("matches {pattern}")),
        number("default").map(|default| format!("{default} by default")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Returns a text member; empty if there is none.
pub fn text<'d>(of: &'d Value, name: &str) -> &'d str {
    of[name].as_str().unwrap_or_default()
}

/// Writes a value without the quotes of JSON.
pub fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned)
}

impl std::fmt::Display for Kind<'_> {
    /// Writes the type as markup, with links to the pages of schemas.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for word in &self.0 {
            match word {
                Word::Text(text) => f.write_str(&super::escaped(text))?,
                Word::Schema(name) => write!(f, "<a href=\"/docs/schemas/{name}\">{name}</a>")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn types_are_told_in_words() {
        let told = |schema: Value| kind_of(&schema).to_string();
        assert_eq!(told(json!({ "type": ["string", "null"], "format": "date-time" })), "string or null (date time)");
        assert_eq!(told(json!({ "type": "integer", "format": "int32", "minimum": 0 })), "integer (at least 0)");
        let listed = json!({ "type": "array", "items": { "$ref": "#/components/schemas/Turn" }, "maxItems": 64 });
        assert_eq!(told(listed), "array of <a href=\"/docs/schemas/Turn\">Turn</a> (at most 64 items)");
        assert_eq!(told(json!({ "enum": ["a", "b"] })), "a, b");
        assert_eq!(told(json!({ "oneOf": [{ "type": "string" }, { "type": "null" }] })), "string or null");
    }
}
