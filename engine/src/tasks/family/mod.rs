//! Family files: one TOML file per family of tasks, from which its instances are expanded.
//!
//! A file gives a grid of parameters, wordings, and checks whose arguments are expressions of the parameters. Each
//! point of the grid is an item, each wording of an item a task. `tasks/README.md` explains the format to its writers.

mod draw;
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

pub use expand::Parameters;
pub use manifest::{Lite, SuiteSource, Version};
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
    /// Its name in files and the API.
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

/// A family file as its writer sees it. Strings are templates: `{{ … }}` holds an expression of the parameters.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "plumbline task family")]
pub struct FamilyFile {
    /// First part of the ids of its tasks: lower-case letters, digits and dashes.
    #[schemars(with = "String")]
    pub family: Spanned<String>,
    /// What the family is called in lists.
    pub title: String,
    /// One of the five categories.
    pub category: Category,
    /// One of the 17 types that the paper tells apart.
    #[serde(rename = "type")]
    pub kind: String,
    /// What the family asks for, in a sentence or two.
    pub description: String,
    /// Second part of an id, before the wording's name; empty where the grid has one point.
    #[schemars(with = "String")]
    pub instance: Spanned<String>,
    /// The grid of parameters. Within a table, parameters vary together; tables multiply, the first slowest.
    #[serde(default)]
    #[schemars(with = "Vec<BTreeMap<String, Vec<Value>>>")]
    pub grid: Vec<BTreeMap<String, Spanned<Vec<toml::Value>>>>,
    /// Phrases that prompts may use as variables.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub words: BTreeMap<String, Spanned<String>>,
    /// The prompts of wordings that have none of their own, one per turn.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub prompts: Vec<Spanned<String>>,
    /// The wordings: each makes a task of each item.
    pub wordings: Vec<Wording>,
    /// The checks of every turn.
    pub checks: Vec<CheckEntry>,
    /// How parameters are drawn, where a hidden suite has the family; it has no grid then.
    #[serde(default)]
    pub draw: Option<DrawRules>,
}

/// How the parameters of a hidden family's instances are drawn.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawRules {
    /// Families of the public suite whose difficulty it keeps: a draw takes as many instances. None for a family of which the
    /// public suite has nothing; a draw takes one of those.
    #[serde(default)]
    pub stands_for: Vec<String>,
    /// The parameters, in the order in which they are drawn.
    pub parameters: Vec<DrawnParameter>,
    /// Expressions: what is drawn counts where all are true; else it is drawn again.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub only: Vec<Spanned<String>>,
    /// Whether the stress in equilibrium of the reference build becomes the parameter `reference_pa`.
    #[serde(default)]
    pub needs_reference: bool,
}

/// A parameter: drawn from whole numbers or from a list, or computed.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawnParameter {
    /// Its name.
    pub name: String,
    /// The least and the greatest whole number.
    #[serde(default)]
    pub from: Option<[i64; 2]>,
    /// The list.
    #[serde(default)]
    #[schemars(with = "Option<Vec<Value>>")]
    pub of: Option<Vec<toml::Value>>,
    /// A value with expressions of the parameters before it.
    #[serde(default)]
    #[schemars(with = "Option<Value>")]
    pub is: Option<Spanned<toml::Value>>,
}

/// One way to word the instructions.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Wording {
    /// Last part of the id: lower-case letters, digits and dashes; may be empty where there is one wording only.
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// Expression: only items for which it is true have this wording.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// Phrases that prompts may use as variables, beside the family's.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub words: BTreeMap<String, Spanned<String>>,
    /// One prompt per turn, instead of the family's.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub prompts: Vec<Spanned<String>>,
}

/// A check with arguments that may be expressions.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckEntry {
    /// Name of the check.
    #[serde(rename = "fn")]
    #[schemars(with = "String")]
    pub name: Spanned<String>,
    /// Its arguments by name. A string that is one `{{ … }}` takes the value of the expression.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, Value>")]
    pub args: BTreeMap<String, Spanned<toml::Value>>,
    /// Expression: only items and turns for which it is true have this check.
    #[serde(default)]
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// Repeats the check for each value of a list: a variable's name with an expression for the list.
    #[serde(default)]
    #[schemars(with = "BTreeMap<String, String>")]
    pub each: BTreeMap<String, Spanned<String>>,
    /// First version of the suite that has this check.
    #[serde(default = "first")]
    pub since: u32,
    /// From this version of the suite on the check is shown and does not count.
    #[serde(default)]
    pub informational_since: Option<u32>,
}

const fn first() -> u32 {
    1
}

/// A family file with its text, which faults refer to.
#[derive(Debug, Clone)]
pub struct Family {
    /// File name.
    pub file: String,
    text: String,
    /// Content.
    pub content: FamilyFile,
}

impl Family {
    /// Reads a family file.
    ///
    /// # Errors
    /// A fault with its line where the text is not TOML or has not the fields of a family.
    pub fn read(file: &str, text: &str) -> Result<Self, TaskFileFault> {
        let content = toml::from_str(text).map_err(|error| faults::of_toml(file, text, &error))?;
        Ok(Self { file: file.to_owned(), text: text.to_owned(), content })
    }

    /// The family's name.
    #[must_use]
    pub fn name(&self) -> &str {
        self.content.family.get_ref()
    }

    /// The items of the grid, in order; one without parameters where there is no grid.
    #[must_use]
    pub fn items(&self) -> Vec<Map<String, Value>> {
        expand::items(&self.content.grid)
    }
}
