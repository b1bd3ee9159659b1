//! Operations of the OpenAPI document, as pages show them.

use serde_json::Value;

use super::prose;
use super::schemas::{Kind, Member, kind_of, members_of, plain, text};
use crate::http::extract::origin::Origin;

/// Methods, in the order in which the operations of a path are listed.
const METHODS: [&str; 4] = ["get", "post", "put", "delete"];

/// Operations that belong together.
pub struct Tag<'d> {
    /// Name of the tag.
    pub name: &'d str,
    /// Description as markup.
    pub about: String,
    /// The operations: identifier, method, path and summary.
    pub operations: Vec<(&'d str, String, &'d str, &'d str)>,
}

/// An operation with everything that its page shows.
pub struct Operation<'d> {
    /// Method in capitals.
    pub method: String,
    /// Path with its parameters in braces.
    pub path: &'d str,
    /// Summary.
    pub summary: &'d str,
    /// Description as markup.
    pub about: String,
    /// Whether it needs a key.
    pub needs_key: bool,
    /// Parameters: place, name, type, and description as markup.
    pub parameters: Vec<Parameter<'d>>,
    /// Bodies that it takes, by media type.
    pub bodies: Vec<Content<'d>>,
    /// Responses that it gives.
    pub responses: Vec<Response<'d>>,
    /// Errors: status and description.
    pub errors: Vec<(&'d str, &'d str)>,
}

/// A parameter of an operation.
pub struct Parameter<'d> {
    /// Name.
    pub name: &'d str,
    /// Where it is: path, query or header.
    pub place: &'d str,
    /// Whether it must be there.
    pub is_required: bool,
    /// Type.
    pub kind: Kind<'d>,
    /// Description as markup.
    pub about: String,
    /// An example of its value.
    example: Option<String>,
}

impl Parameter<'_> {
    /// Returns a value for a command: the example, or else the name in capitals.
    fn value(&self) -> String {
        self.example.clone().unwrap_or_else(|| self.name.to_uppercase())
    }
}

/// A body in one media type.
pub struct Content<'d> {
    /// Media type.
    pub media: &'d str,
    /// Type.
    pub kind: Kind<'d>,
    /// Members of the body, if it is an object.
    pub members: Vec<Member<'d>>,
    /// An example, as text.
    pub example: Option<String>,
}

/// A response that is no error.
pub struct Response<'d> {
    /// Status.
    pub status: &'d str,
    /// Description.
    pub about: &'d str,
    /// Headers with their descriptions.
    pub headers: Vec<(&'d str, &'d str)>,
    /// Its bodies, by media type.
    pub bodies: Vec<Content<'d>>,
}

/// Returns all operations: path, method and operation.
pub fn all(document: &Value) -> impl Iterator<Item = (&str, &'static str, &Value)> {
    let paths = document["paths"].as_object().into_iter().flatten();
    paths.flat_map(|(path, item)| {
        METHODS.into_iter().filter_map(move |method| Some((path.as_str(), method, item.get(method)?)))
    })
}

/// Returns the identifier of an operation.
pub fn id_of(told: &Value) -> &str {
    text(told, "operationId")
}

/// Returns the operations by their tags, in the order of the document.
pub fn by_tag(document: &Value) -> Vec<Tag<'_>> {
    let tags = document["tags"].as_array().into_iter().flatten();
    tags.map(|tag| {
        let name = text(tag, "name");
        let has_tag = |told: &Value| told["tags"].as_array().is_some_and(|tags| tags.iter().any(|own| *own == name));
        let of_tag = all(document).filter(|(_, _, told)| has_tag(told));
        let line = |(path, method, told)| (id_of(told), str::to_uppercase(method), path, text(told, "summary"));
        Tag { name, about: prose(text(tag, "description")), operations: of_tag.map(line).collect() }
    })
    .collect()
}

impl<'d> Operation<'d> {
    /// Returns the operation with this identifier.
    pub fn named(document: &'d Value, id: &str) -> Option<Self> {
        let (path, method, told) = all(document).find(|(_, _, told)| id_of(told) == id)?;
        let parameters = told["parameters"].as_array().into_iter().flatten().map(|it| Parameter {
            name: text(it, "name"),
            place: text(it, "in"),
            is_required: it["required"] == true,
            kind: kind_of(&it["schema"]),
            about: prose(text(it, "description")),
            example: it.get("example").or_else(|| it["schema"].get("example")).map(plain),
        });
        let responses = told["responses"].as_object().into_iter().flatten();
        let (fine, errors): (Vec<_>, Vec<_>) = responses.partition(|(status, _)| !status.starts_with(['4', '5']));
        let response = |(status, it): (&'d String, &'d Value)| {
            let headers = it["headers"].as_object().into_iter().flatten();
            Response {
                status,
                about: text(it, "description"),
                headers: headers.map(|(name, header)| (name.as_str(), text(header, "description"))).collect(),
                bodies: contents(&it["content"], document),
            }
        };
        Some(Self {
            method: method.to_uppercase(),
            path,
            summary: text(told, "summary"),
            about: prose(text(told, "description")),
            needs_key: told["security"].as_array().is_some_and(|needs| !needs.is_empty()),
            parameters: parameters.collect(),
            bodies: contents(&told["requestBody"]["content"], document),
            responses: fine.into_iter().map(response).collect(),
            errors: errors.into_iter().map(|(status, it)| (status.as_str(), text(it, "description"))).collect(),
        })
    }

    /// Returns a command that calls the operation.
    pub fn command(&self, origin: &Origin) -> String {
        let sent = self.bodies.first();
        let method = if self.method == "GET" { String::new() } else { format!(" -X {}", self.method) };
        let key = if self.needs_key { " -H 'authorization: Bearer plk_…'" } else { "" };
        let kind = sent.map(|body| format!(" -H 'content-type: {}'", body.media)).unwrap_or_default();
        let body = match sent.map(|body| &body.example) {
            Some(Some(example)) => format!(" \\\n  -d '{}'", example.replace('\'', "'\\''")),
            Some(None) => " \\\n  --data-binary @FILE".to_owned(),
            None => String::new(),
        };
        let mut path = self.path.to_owned();
        for it in self.parameters.iter().filter(|it| it.place == "path") {
            path = path.replace(&format!("{{{}}}", it.name), &it.value());
        }
        let needed = self.parameters.iter().filter(|it| it.is_required && it.place == "query");
        let needed: Vec<String> = needed.map(|it| format!("{}={}", it.name, it.value())).collect();
        let query = if needed.is_empty() { String::new() } else { format!("?{}", needed.join("&")) };
        format!("curl -s{method}{key}{kind} \\\n  '{origin}{path}{query}'{body}")
    }
}

/// Returns the bodies by media type.
fn contents<'d>(content: &'d Value, document: &'d Value) -> Vec<Content<'d>> {
    let one = |(media, it): (&'d String, &'d Value)| {
        let schema = &it["schema"];
        let named =
            schema.get("$ref").and_then(Value::as_str).and_then(|name| document.pointer(name.strip_prefix('#')?));
        let example = it.get("example").or_else(|| named?.get("example"));
        Content {
            media,
            kind: kind_of(schema),
            members: members_of(named.unwrap_or(schema), document),
            example: example.map(|example| match example {
                Value::String(text) => text.clone(),
                other => serde_json::to_string_pretty(other).expect("a value is JSON"),
            }),
        }
    };
    content.as_object().into_iter().flatten().map(one).collect()
}
