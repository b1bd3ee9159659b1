//! Blocks (`/v1/blocks`): the names that prompts, code and logs use.

use axum::Json;
use serde::Serialize;

use plumbline_engine::game::registry::{Block, Property};
use plumbline_engine::voxel::blocks::GAME_VERSION;

/// A kind of block.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BlockBody {
    /// Name without a namespace.
    #[schema(example = "oak_door")]
    pub name: &'static str,
    /// Properties of its states with their values, each in the game's order, as in `oak_door[half=upper]`.
    pub properties: Vec<PropertyBody>,
}

/// A property of a block.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct PropertyBody {
    /// Name of the property.
    #[schema(example = "half")]
    pub name: &'static str,
    /// Possible values.
    #[schema(example = json!(["upper", "lower"]))]
    pub values: &'static [&'static str],
}

/// List of blocks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BlockList {
    /// Version of the game whose blocks they are.
    #[schema(example = "1.21.4")]
    pub game_version: &'static str,
    /// The blocks, in the game's order.
    pub blocks: Vec<BlockBody>,
}

/// Returns the blocks that the service knows.
///
/// Each block has the properties of its states. Logs under the profile `published` may have other names; an advisory
/// names them.
#[utoipa::path(
    get, path = "/v1/blocks", operation_id = "list_blocks", tag = "service", summary = "List blocks",
    responses(
        (status = 200, description = "The blocks", body = BlockList,
         example = json!({ "game_version": "1.21.4", "blocks": [
             { "name": "oak_door", "properties": [{ "name": "half", "values": ["upper", "lower"] }] },
         ] })),
    )
)]
pub async fn list_blocks() -> Json<BlockList> {
    let property = |own: &'static Property| PropertyBody { name: own.name, values: &own.values };
    let body =
        |own: &'static Block| BlockBody { name: own.name, properties: own.properties.iter().map(property).collect() };
    Json(BlockList { game_version: GAME_VERSION, blocks: Block::all().iter().map(body).collect() })
}
