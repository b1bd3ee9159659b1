//! Suites: what a wrong name may have meant, and draws of Lite suites.

use crate::app::App;
use crate::app::error::{AppError, AppResult, Kind};
use plumbline_engine::tasks::Suite;
use plumbline_engine::tasks::catalogue::Catalogue;
use plumbline_engine::tasks::embedded::{self, LITE_SUFFIX};
use plumbline_engine::text::did_you_mean;

/// Draws a Lite suite with another seed.
///
/// # Errors
/// Returns an error if there is no such suite, if it is not a Lite suite, or if the database fails.
pub async fn draw(app: &App, name: &str, seed: u64) -> AppResult<Suite> {
    let entry = app.suite(name).await?;
    let Some(full) = entry.suite.name.strip_suffix(LITE_SUFFIX) else {
        let detail = format!("seed applies only to Lite suites; {} is not a Lite suite", entry.id);
        return Err(AppError::new(Kind::BadRequest, detail));
    };
    let full = app.suite(&format!("{full}@{}", entry.suite.version)).await?;
    Ok(embedded::lite(&full.suite, seed))
}

/// Says that there is no suite of a name, and which one it may have meant.
#[must_use]
pub fn no_suite(catalogue: &Catalogue, name: &str) -> String {
    let suites = catalogue.suites().iter().flat_map(|entry| [entry.suite.name.clone(), entry.id.clone()]);
    let names: std::collections::BTreeSet<String> = suites.collect();
    let near = did_you_mean(name, names.iter().map(String::as_str));
    format!("there is no suite {name:?}; /v1/suites lists them{near}")
}
