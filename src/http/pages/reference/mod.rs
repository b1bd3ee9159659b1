//! The API reference: pages made from the OpenAPI document, one for each operation and each schema. They need no
//! script, and load nothing else.

mod operations;
mod schemas;

use std::sync::OnceLock;

use askama::Template;
use axum::Router;
use axum::extract::{Path, State};
use axum::response::Redirect;
use axum::routing::get;
use serde_json::Value;

use self::operations::{Operation, Tag};
use self::schemas::SchemaPage;
use super::html::{self, PageResult, escaped};
use crate::app::error::{AppError, AppResult};
use crate::http::extract::origin::Origin;
use crate::http::state::AppState;
use plumbline_engine::text::did_you_mean;

/// Returns the routes of the reference.
pub fn routes() -> Router<AppState> {
    Router::new()
        .route("/docs", get(async || Redirect::permanent("/docs/")))
        .route("/docs/", get(index))
        .route("/docs/{operation}", get(operation))
        .route("/docs/schemas/{name}", get(schema))
}

#[derive(Template)]
#[template(path = "reference/index.html")]
struct IndexPage<'d> {
    about: String,
    tags: Vec<Tag<'d>>,
    origin: Origin,
}

/// Serves the list of all operations.
async fn index(State(state): State<AppState>, origin: Origin) -> PageResult {
    let document = document(&state)?;
    let about = prose(document["info"]["description"].as_str().unwrap_or_default());
    html::page(&IndexPage { about, tags: operations::by_tag(document), origin })
}

#[derive(Template)]
#[template(path = "reference/operation.html")]
struct OperationPage<'d> {
    told: Operation<'d>,
    origin: Origin,
}

/// Serves the page of an operation.
async fn operation(State(state): State<AppState>, origin: Origin, Path(id): Path<String>) -> PageResult {
    let document = document(&state)?;
    let told = Operation::named(document, &id).ok_or_else(|| {
        let near = did_you_mean(&id, operations::all(document).map(|(_, _, told)| operations::id_of(told)));
        AppError::not_found(format!("there is no operation {id:?}{near}"))
    })?;
    html::page(&OperationPage { told, origin })
}

/// Serves the page of a schema.
async fn schema(State(state): State<AppState>, Path(name): Path<String>) -> PageResult {
    let document = document(&state)?;
    let Some(schema) = document["components"]["schemas"].get(&name) else {
        return Err(AppError::not_found(format!("there is no schema {name:?}")).into());
    };
    html::page(&SchemaPage::of(&name, schema, document))
}

/// Returns the OpenAPI document. It is read once: a process has one.
fn document(state: &AppState) -> AppResult<&'static Value> {
    static DOCUMENT: OnceLock<Value> = OnceLock::new();
    if let Some(document) = DOCUMENT.get() {
        return Ok(document);
    }
    let document = serde_json::from_str(&state.openapi).map_err(|error| AppError::internal(&error))?;
    Ok(DOCUMENT.get_or_init(|| document))
}

/// Writes a description as markup: paragraphs, and code between backquotes.
fn prose(text: &str) -> String {
    let code = |paragraph: &str| {
        let parts = paragraph.split('`').enumerate();
        parts
            .map(|(i, part)| if i % 2 == 1 { format!("<code>{}</code>", escaped(part)) } else { escaped(part) })
            .collect::<String>()
    };
    let paragraphs = text.split("\n\n").filter(|paragraph| !paragraph.trim().is_empty());
    paragraphs.flat_map(|paragraph| ["<p>".to_owned(), code(paragraph), "</p>\n".to_owned()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::router;

    #[test]
    fn every_operation_and_schema_has_a_page() {
        let document: Value = serde_json::from_str(&router::document()).unwrap();
        let named: Vec<&str> = operations::all(&document).map(|(_, _, told)| operations::id_of(told)).collect();
        assert!(named.len() > 80, "{}", named.len());
        let origin = Origin { is_secure: false, host: "localhost".to_owned() };
        for id in named {
            let told = Operation::named(&document, id).unwrap_or_else(|| panic!("{id}"));
            let page = OperationPage { told, origin: origin.clone() }.render().unwrap();
            assert!(page.contains("curl ") && !page.contains(">null<"), "{id}");
        }
        for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
            SchemaPage::of(name, schema, &document).render().unwrap();
        }
        let listed: usize = operations::by_tag(&document).iter().map(|tag| tag.operations.len()).sum();
        assert_eq!(listed, operations::all(&document).count(), "every operation has a tag that is described");
    }

    #[test]
    fn descriptions_are_paragraphs_with_code() {
        assert_eq!(prose("a `<b>` c\n\nd & e"), "<p>a <code>&lt;b&gt;</code> c</p>\n<p>d &amp; e</p>\n");
    }
}
