//! What 3D views need to know about materials.

use serde::Deserialize;
use serde_json::{Value, json};

use crate::app::error::AppError;
use crate::pictures::colours::{self, Look};

/// Says how each material of a palette looks: the colours of its top and its sides, and its boxes, in sixteenths of a
/// block, if it does not fill its cell.
pub fn looks_of<'a>(palette: impl IntoIterator<Item = &'a str>) -> Value {
    let look = |name: &str| {
        let Look { top, side, boxes } = colours::look(name);
        if boxes.is_empty() { json!([top, side]) } else { json!([top, side, boxes]) }
    };
    palette.into_iter().map(|name| (name.to_owned(), look(name))).collect::<serde_json::Map<_, _>>().into()
}

/// Reads the material names of a log's palette without building the rest of the log in memory.
///
/// # Errors
/// Returns an error if the text is no log.
pub fn palette(json: &[u8]) -> Result<Vec<String>, AppError> {
    #[derive(Deserialize)]
    struct Head {
        palette: Vec<String>,
    }
    serde_json::from_slice::<Head>(json).map(|head| head.palette).map_err(|error| AppError::internal(&error))
}
