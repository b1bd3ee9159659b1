//! Profiles (`/v1/profiles`): the rules under which actions become a build.

use axum::Json;
use serde::Serialize;

use crate::actions::Profile;
use crate::actions::functions::{KnownFunction, functions_of};
use plumbline_engine::voxel::blocks::GAME_VERSION;

/// A profile.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ProfileBody {
    /// Name of the profile, as requests give it.
    pub name: Profile,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// What it is the default for.
    pub default_for: &'static str,
    /// Version of the game whose commands and blocks it knows; null if it knows none.
    pub game_version: Option<&'static str>,
    /// Forms of code that it reads.
    pub code: &'static str,
    /// Functions that code finds. Any other name is told in the notes of a replay.
    pub functions: &'static [KnownFunction],
}

/// List of profiles.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ProfileList {
    /// The profiles.
    pub profiles: Vec<ProfileBody>,
}

impl ProfileBody {
    fn of(name: Profile) -> Self {
        let functions = functions_of(name);
        match name {
            Profile::Published => Self {
                name,
                about: "Calls that place and break blocks are recorded as the published pipeline records them. Code sees \
                        only air, and a removal only reaches blocks of earlier turns.",
                default_for: "plain events, and action code for suites before mineceraft@3",
                game_version: None,
                code: "a function expression, export default, or module.exports; of several code fences the last one",
                functions,
            },
            Profile::Mindcraft => Self {
                name,
                about: "Code acts as a bot of the mindcraft framework does in a game with cheats on: in a flat world that \
                        holds what earlier turns built, and that answers. Events count in their true order.",
                default_for: "action code for suites from mineceraft@3 on, and for hidden epochs created with this version",
                game_version: Some(GAME_VERSION),
                code: "the answer of a model as it came: what stands between the first code fence and the last, or all of \
                       it if there is none; the body of a function, a function, or a module",
                functions,
            },
        }
    }
}

/// Lists the profiles.
///
/// Each profile has the functions that action code finds under it.
#[utoipa::path(
    get, path = "/v1/profiles", operation_id = "list_profiles", tag = "service", summary = "List profiles",
    responses(
        (status = 200, description = "The profiles", body = ProfileList,
         example = json!({ "profiles": [{
             "name": "mindcraft", "about": "Code acts as a bot of the mindcraft framework does.",
             "default_for": "action code for suites from mineceraft@3 on", "game_version": "1.21.4",
             "code": "the answer of a model as it came",
             "functions": [{ "call": "skills.breakBlockAt(bot, x, y, z)", "effect": "acts" }],
         }] })),
    )
)]
pub async fn list_profiles() -> Json<ProfileList> {
    Json(ProfileList { profiles: Profile::ALL.into_iter().map(ProfileBody::of).collect() })
}
