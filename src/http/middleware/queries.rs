//! Refusal of parameters where an operation takes none: ignored, they would look like they had an effect.

use std::collections::HashMap;

use axum::extract::{MatchedPath, Request};
use axum::http::Method;
use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::{OpenApi, RefOr};

use crate::app::error::{AppError, AppResult, FaultBody};
use plumbline_engine::intake::Faults;

/// Beginning of the paths whose query string is checked. Trainers may add parameters to the other ones that they call.
const CHECKED: &str = "/v1/";

/// Operations without parameters in the query string, by method and route, and whether they take a body.
#[derive(Debug, Default)]
pub struct Parameterless(HashMap<(Method, String), bool>);

impl Parameterless {
    /// Returns the operations of a document that have no parameters in the query string.
    #[must_use]
    pub fn of(document: &OpenApi) -> Self {
        let mut found = HashMap::new();
        for (path, item) in document.paths.paths.iter().filter(|(path, _)| path.starts_with(CHECKED)) {
            for (method, operation) in [
                (Method::GET, &item.get),
                (Method::POST, &item.post),
                (Method::PUT, &item.put),
                (Method::DELETE, &item.delete),
            ] {
                if let Some(operation) = operation.as_ref().filter(|operation| !takes_query(operation)) {
                    found.insert((method, path.clone()), operation.request_body.is_some());
                }
            }
        }
        Self(found)
    }

    /// Refuses a request that has parameters although its operation takes none.
    ///
    /// # Errors
    /// Returns an error (400) that names each parameter.
    pub fn check(&self, request: &Request) -> AppResult<()> {
        let Some(query) = request.uri().query().filter(|query| !query.is_empty()) else { return Ok(()) };
        let Some(route) = request.extensions().get::<MatchedPath>() else { return Ok(()) };
        let route = route.as_str().strip_prefix("/with-key/{key}").unwrap_or(route.as_str());
        let method = if request.method() == Method::HEAD { &Method::GET } else { request.method() };
        let Some(takes_body) = self.0.get(&(method.clone(), route.to_owned())) else { return Ok(()) };
        let detail = if *takes_body {
            "there is no such parameter; what this takes goes into the body"
        } else {
            "there is no such parameter; this takes none"
        };
        let fault = |name: &str| FaultBody::of_parameter(name.chars().take(100).collect::<String>(), detail);
        let named = form_urlencoded::parse(query.as_bytes()).take(Faults::KEPT);
        let faults: Vec<FaultBody> = named.map(|(name, _)| fault(&name)).collect();
        if faults.is_empty() { Ok(()) } else { Err(AppError::invalid_query(faults)) }
    }
}

fn takes_query(operation: &Operation) -> bool {
    let mut parameters = operation.parameters.iter().flatten();
    parameters.any(|parameter| match parameter {
        RefOr::T(parameter) => parameter.parameter_in == ParameterIn::Query,
        RefOr::Ref(_) => true,
    })
}
