//! Refusal of parameters where an operation takes none: ignored, they would look like they had an effect.

use std::collections::HashSet;

use axum::extract::{MatchedPath, Request};
use axum::http::Method;
use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::{OpenApi, RefOr};

use crate::app::error::{AppError, AppResult, FaultBody};
use plumbline_engine::intake::Faults;

/// Paths whose query string is checked. Trainers may add parameters of their own to the paths that they call.
const CHECKED: &str = "/v1/";

/// Operations without parameters in the query string: method and route.
#[derive(Debug, Default)]
pub struct Parameterless(HashSet<(Method, String)>);

impl Parameterless {
    /// Returns the operations of a document that have no parameters in the query string.
    #[must_use]
    pub fn of(document: &OpenApi) -> Self {
        let mut found = HashSet::new();
        for (path, item) in document.paths.paths.iter().filter(|(path, _)| path.starts_with(CHECKED)) {
            for (method, operation) in [
                (Method::GET, &item.get),
                (Method::POST, &item.post),
                (Method::PUT, &item.put),
                (Method::DELETE, &item.delete),
            ] {
                if operation.as_ref().is_some_and(|operation| !takes_query(operation)) {
                    found.insert((method, path.clone()));
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
        if !self.0.contains(&(method.clone(), route.to_owned())) {
            return Ok(());
        }
        let detail = match *method {
            Method::GET | Method::DELETE => "there is no such parameter; this takes none",
            _ => "there is no such parameter; what this takes goes into the body",
        };
        let named = form_urlencoded::parse(query.as_bytes()).take(Faults::KEPT);
        let fault = |name: &str| FaultBody::of_parameter(name.chars().take(100).collect::<String>(), detail);
        Err(AppError::invalid_query(named.map(|(name, _)| fault(&name)).collect()))
    }
}

fn takes_query(operation: &Operation) -> bool {
    let mut parameters = operation.parameters.iter().flatten();
    parameters.any(|parameter| match parameter {
        RefOr::T(parameter) => parameter.parameter_in == ParameterIn::Query,
        RefOr::Ref(_) => true,
    })
}
