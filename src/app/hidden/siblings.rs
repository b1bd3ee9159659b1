//! The public list of siblings: what official runs draw beside each hidden instance.

use crate::app::error::{AppError, AppResult};
use plumbline_engine::hidden::GENERATOR_VERSION;
use plumbline_engine::hidden::siblings::{FIRST_WITH_SIBLINGS, Siblings};

/// Returns the list of siblings of a version of the generator. A process reads each once.
///
/// # Errors
/// Returns an error (404) if this program has no such version, or it draws none.
pub async fn siblings(version: u32) -> AppResult<&'static Siblings> {
    if !(FIRST_WITH_SIBLINGS..=GENERATOR_VERSION).contains(&version) {
        let detail = format!(
            "no version {version} of the generator draws siblings; versions {FIRST_WITH_SIBLINGS} to {GENERATOR_VERSION} do"
        );
        return Err(AppError::not_found(detail));
    }
    let read = tokio::task::spawn_blocking(move || Siblings::of(version)).await;
    read.map_err(|error| AppError::internal(&error))?.map_err(|error| AppError::internal(&error))
}
