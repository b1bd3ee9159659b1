//! The committed OpenAPI document is the one that the code makes, and it is complete.

use crate::support::repository;
use serde_json::Value;

#[test]
fn the_committed_document_is_the_code_s() {
    let committed = std::fs::read_to_string(repository("openapi/plumbline.json")).unwrap();
    let made = plumbline::http::router::document();
    assert!(committed == made, "run: cargo run -- openapi > openapi/plumbline.json");
}

#[test]
fn every_operation_has_a_summary_examples_and_its_errors() {
    let document: Value = serde_json::from_str(&plumbline::http::router::document()).unwrap();
    // Their summary says everything.
    let self_explaining = ["get_health", "get_limits", "get_openapi"];
    let mut operations = 0;
    for (path, methods) in document["paths"].as_object().unwrap() {
        for (method, operation) in methods.as_object().unwrap() {
            operations += 1;
            let place = format!("{method} {path}");
            for member in ["summary", "operationId"] {
                assert!(operation[member].as_str().is_some_and(|text| !text.is_empty()), "{place}: no {member}");
            }
            let is_short = operation["operationId"].as_str().is_some_and(|id| self_explaining.contains(&id));
            assert!(
                operation["description"].is_null() == is_short,
                "{place}: an empty line ends the first sentence of a doc comment, and what follows is the description"
            );
            let responses = operation["responses"].as_object().unwrap();
            let (_, success) = responses.iter().find(|(status, _)| status.starts_with('2')).unwrap();
            let content = success["content"].as_object().unwrap();
            assert!(content.values().all(|media| !media["example"].is_null()), "{place}: no example");
            let infallible = ["/healthz", "/v1/limits", "/openapi.json"];
            let errors = responses.iter().filter(|(status, _)| status.as_str() >= "400");
            let mut described = 0;
            for (status, error) in errors {
                described += 1;
                let content = &error["content"]["application/problem+json"];
                assert!(!content.is_null(), "{place}: {status} is not a problem");
            }
            assert!(described > 0 || infallible.contains(&path.as_str()), "{place}: no errors");
        }
    }
    assert_eq!(operations, 91);
}
