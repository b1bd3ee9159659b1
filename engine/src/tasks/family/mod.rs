//! Family files: one TOML file per family of tasks, which is expanded into the tasks of the family.
//!
//! A file has a grid of parameters, wordings, and checks whose arguments are expressions of the parameters. Each point
//! of the grid is an item, and each wording of an item is a task. `tasks/README.md` documents the format for authors.

mod draw;
mod entailment;
mod expand;
mod faults;
mod manifest;
mod schema;
mod template;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Map, Value};
use toml::Spanned;

pub use entailment::table as entailment_table;
pub use expand::Parameters;
pub use manifest::{Edition, Lite, SuiteSource, Version};
pub use schema::json_schema;

use super::published::TaskFileFault;

/// One of the five categories of tasks (paper, section 3).
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    serde::Serialize,
    Deserialize,
    JsonSchema,
    utoipa::ToSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Category {
    /// Foundations, walls, roofs, columns, frames.
    StructuralElements,
    /// Basic buildings, rooms, bedrooms, multi-story buildings.
    BuildingTypes,
    /// Accessibility and creative requests.
    ArchitecturalElements,
    /// Resource optimization, planning, revision.
    ConstructionManagement,
    /// Bridges, arch bridges, domes.
    CivilEngineering,
}

impl Category {
    /// Returns the name of the category in files and the API.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::StructuralElements => "structural-elements",
            Self::BuildingTypes => "building-types",
            Self::ArchitecturalElements => "architectural-elements",
            Self::ConstructionManagement => "construction-management",
            Self::CivilEngineering => "civil-engineering",
        }
    }
}

/// Content of a family file. Strings are templates, in which `{{ … }}` holds an expression of the parameters.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "plumbline task family")]
pub struct FamilyFile {
    /// Name of the family, and first part of the ids of its tasks: lower-case letters, digits and dashes.
    #[schemars(with = "String")]
    pub family: Spanned<String>,
    /// Title of the family in lists.
    pub title: String,
    /// Category of the family, one of five.
    pub category: Category,
    /// Type of the family; the paper distinguishes 17.
    #[serde(rename = "type")]
    pub kind: String,
    /// Summary of what the family asks for, in a sentence or two.
    pub description: String,
    /// Second part of an id, before the wording's name; may be empty if the grid has only one point.
    #[schemars(with = "String")]
    pub instance: Spanned<String>,
    /// Grid of parameters. The lists of a table vary together; tables multiply, the first varying slowest.
    #[serde(default)]
    #[schemars(with = "Vec<BTreeMap<String, Vec<Value>>>")]
    pub grid: Vec<BTreeMap<String, Spanned<Vec<toml::Value>>>>,
    /// Phrases that prompts can use as variables.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub words: BTreeMap<String, Spanned<String>>,
    /// Prompts for wordings that have none of their own, one per turn.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub prompts: Vec<Spanned<String>>,
    /// Prompts of the track `brief`, one per turn, for wordings that have none of their own.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub brief: Vec<Spanned<String>>,
    /// What the prompts mention and no check measures. Prompts tell it with `{{ unmeasured }}`.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub unmeasured: Vec<Spanned<String>>,
    /// Wordings; each makes a task of each item.
    pub wordings: Vec<Wording>,
    /// Checks of every turn.
    pub checks: Vec<CheckEntry>,
    /// Rules for drawing parameters; a family of a hidden suite has them instead of a grid.
    #[serde(default)]
    pub draw: Option<DrawRules>,
}

/// Rules for drawing the parameters of a hidden family's instances.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawRules {
    /// Public families whose difficulty this family matches; a run gets one instance for each of them. Empty for a
    /// family without a public counterpart: the epoch's key picks one such family, and a run gets one instance of it.
    #[serde(default)]
    pub stands_for: Vec<String>,
    /// Parameters, in the order in which they are drawn.
    pub parameters: Vec<DrawnParameter>,
    /// Expressions that must all be true of the parameters drawn; otherwise they are drawn again.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub only: Vec<Spanned<String>>,
    /// Whether the greatest equilibrium stress of the reference build, in Pa, becomes the parameter `reference_pa`.
    #[serde(default)]
    pub needs_reference: bool,
}

/// A parameter that is drawn from a range or a list, or computed. Exactly one of `from`, `of` and `is` is set.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawnParameter {
    /// Name of the parameter.
    pub name: String,
    /// Least and greatest whole number that can be drawn.
    #[serde(default)]
    pub from: Option<[i64; 2]>,
    /// Values that can be drawn.
    #[serde(default)]
    #[schemars(with = "Option<Vec<Value>>")]
    pub of: Option<Vec<toml::Value>>,
    /// Value computed with expressions of the parameters before it.
    #[serde(default)]
    #[schemars(with = "Option<Value>")]
    pub is: Option<Spanned<toml::Value>>,
}

/// One wording of the instructions.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wording {
    /// Last part of the id: lower-case letters, digits and dashes; may be empty if there is only one wording.
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// Expression; only items for which it is true have this wording.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// Phrases that prompts can use as variables, in addition to the family's.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub words: BTreeMap<String, Spanned<String>>,
    /// Prompts in place of the family's, one per turn.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub prompts: Vec<Spanned<String>>,
    /// Prompts of the track `brief` in place of the family's, one per turn.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub brief: Vec<Spanned<String>>,
}

/// A check whose arguments may be expressions.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckEntry {
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// Arguments by name. A string that is a single `{{ … }}` takes the value, of any type, of the expression.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, Value>")]
    pub args: BTreeMap<String, Spanned<toml::Value>>,
    /// Expression; only items and turns for which it is true have this check.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// Repeats the check for each value of a list: the name of a variable, with an expression for the list.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub each: BTreeMap<String, Spanned<String>>,
    /// Names of the phrases that ask for this check. The first must occur in the prompt of the turn or of a turn before
    /// it; on the track `brief` one of them must, or be in the preamble.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub asked_by: Vec<Spanned<String>>,
    /// First version of the suite that has this check.
    #[serde(default = "first")]
    pub since: u32,
    /// Version of the suite from which on the check is reported but does not count.
    #[serde(default)]
    pub informational_since: Option<u32>,
}

const fn first() -> u32 {
    1
}

impl CheckEntry {
    /// Returns whether a version of the suite has this check and counts it.
    fn counts_in(&self, version: u32) -> bool {
        self.since <= version && self.informational_since.is_none_or(|since| since > version)
    }
}

/// A family file with its text, in which faults are located.
#[derive(Debug, Clone)]
pub struct Family {
    /// Name of the file.
    pub file: String,
    text: String,
    /// Parsed content of the file.
    pub content: FamilyFile,
}

impl Family {
    /// Parses the text of a family file.
    ///
    /// # Errors
    /// Returns a fault with its line if the text is not TOML, or its fields are not those of a family.
    pub fn read(file: &str, text: &str) -> Result<Self, TaskFileFault> {
        let content = toml::from_str(text).map_err(|error| faults::of_toml(file, text, &error))?;
        Ok(Self { file: file.to_owned(), text: text.to_owned(), content })
    }

    /// Returns the name of the family.
    #[must_use]
    pub fn name(&self) -> &str {
        self.content.family.get_ref()
    }

    /// Returns the items of the grid, in order. Without a grid there is one item, which has no parameters.
    #[must_use]
    pub fn items(&self) -> Vec<Map<String, Value>> {
        expand::items(&self.content.grid)
    }
}
