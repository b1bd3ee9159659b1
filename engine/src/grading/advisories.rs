//! Advisories: what a reader of a report must know beside the scores (SPEC 7). They never change a score.

use serde::{Deserialize, Serialize};

use super::report::TurnReport;
use crate::checks::Check;
use crate::tasks::Instruction;
use crate::voxel::{Structure, blocks};

/// One thing to know about a graded structure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Advisory {
    /// What kind of thing; stable, for programs.
    pub code: AdvisoryCode,
    /// Turn it concerns, from 1.
    pub turn: u32,
    /// Check it concerns: index in the turn's checks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check: Option<u32>,
    /// The thing in words.
    pub detail: String,
}

impl Advisory {
    /// Bytes of memory that it takes.
    #[must_use]
    pub const fn heap_bytes(&self) -> usize {
        size_of::<Self>() + self.detail.capacity()
    }
}

/// Kinds of advisories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AdvisoryCode {
    /// Nothing stands.
    EmptyStructure,
    /// A check held because there was nothing to check.
    HeldVacuously,
    /// The stress figure is unreliable or undefined.
    UnreliableStress,
    /// The equilibrium shown beside the stress figure leaves something out.
    IncompleteEquilibrium,
    /// One cell is listed more than once.
    RepeatedCell,
    /// "air" was placed as a block.
    AirPlaced,
    /// Names carry the `minecraft:` prefix, which exact comparisons do not strip.
    NamespacedNames,
    /// Every block lies at y <= 0.
    EntirelyInGround,
    /// A wanted material matched only as part of another block's name.
    LookalikeMaterial,
    /// The game has no block of a name.
    UnknownBlock,
}

/// Pairs of a wanted word and a block family that contains it by accident of spelling.
const LOOKALIKES: [(&str, &str); 6] = [
    ("bed", "bedrock"),
    ("bed", "embedded"),
    ("door", "trapdoor"),
    ("red", "redstone"),
    ("oak", "dark_oak"),
    ("stone", "cobblestone"),
];

/// Adds the advisories on one turn.
pub fn advise(structure: &Structure, instruction: &Instruction, report: &TurnReport, advisories: &mut Vec<Advisory>) {
    let mut add = |code, check: Option<usize>, detail: String| {
        let check = check.and_then(|c| u32::try_from(c).ok());
        advisories.push(Advisory { code, turn: report.turn, check, detail });
    };
    if structure.is_empty() {
        add(AdvisoryCode::EmptyStructure, None, "no blocks stand".to_owned());
    } else if structure.cells().iter().all(|cell| cell.y <= 0) {
        add(AdvisoryCode::EntirelyInGround, None, "every block lies at y <= 0".to_owned());
    }
    let repeated = structure.len() - structure.distinct_cells();
    if repeated > 0 {
        add(AdvisoryCode::RepeatedCell, None, format!("{repeated} entries repeat a cell that is already listed"));
    }
    let standing = standing_names(structure);
    if standing
        .iter()
        .any(|name| matches!(name.strip_prefix("minecraft:").unwrap_or(name), "air" | "cave_air" | "void_air"))
    {
        add(AdvisoryCode::AirPlaced, None, "air was placed and counts as a block".to_owned());
    }
    let prefixed = standing.iter().filter(|name| name.starts_with("minecraft:")).count();
    if prefixed > 0 {
        add(AdvisoryCode::NamespacedNames, None, format!("{prefixed} material names start with \"minecraft:\""));
    }
    let unknown: Vec<&str> = standing.iter().copied().filter(|name| !blocks::is_known(name)).collect();
    if !unknown.is_empty() {
        let detail = format!("Minecraft {} has no block called {}", blocks::GAME_VERSION, unknown.join(", "));
        add(AdvisoryCode::UnknownBlock, None, detail);
    }
    for (i, check) in report.checks.iter().enumerate() {
        if check.finding.vacuous {
            add(AdvisoryCode::HeldVacuously, Some(i), format!("{}: {}", check.name, check.finding.summary));
        }
        for caution in &check.finding.cautions {
            add(AdvisoryCode::UnreliableStress, Some(i), caution.clone());
        }
        for caution in check.finding.stress.iter().flat_map(|stress| &stress.fem.cautions) {
            add(AdvisoryCode::IncompleteEquilibrium, Some(i), caution.clone());
        }
    }
    for (i, check) in instruction.checks.iter().enumerate() {
        for (wanted, family) in LOOKALIKES {
            if !wants_as_part_of_a_name(check, wanted) {
                continue;
            }
            let matching = || standing.iter().filter(|name| name.to_lowercase().contains(wanted));
            let accidental = |name: &&&str| name.to_lowercase().contains(family);
            if matching().next().is_some() && matching().all(|name| accidental(&name)) {
                let detail = format!("{}: {wanted:?} matched only as part of {family:?}", check.name());
                add(AdvisoryCode::LookalikeMaterial, Some(i), detail);
            }
        }
    }
}

/// Names that some standing block has.
fn standing_names(structure: &Structure) -> Vec<&str> {
    let mut stands = vec![false; structure.palette().len()];
    for &id in structure.material_ids() {
        stands[id as usize] = true;
    }
    structure.palette().names().zip(stands).filter(|(_, stands)| *stands).map(|(name, _)| name).collect()
}

/// Whether the check wants `word` and takes it as part of a longer name.
fn wants_as_part_of_a_name(check: &Check, word: &str) -> bool {
    let counted = |material: &Option<String>, substring: bool| substring && material.as_deref() == Some(word);
    match check {
        Check::BlockCountEqualTo(c) => counted(&c.expected_material, c.use_substring_match),
        Check::BlockCountLargerThan(c) => counted(&c.expected_material, c.use_substring_match),
        Check::BlockCountAtLeast(c) => counted(&c.expected_material, c.use_substring_match),
        Check::BlockCountAtMost(c) => counted(&c.expected_material, c.use_substring_match),
        Check::HighestBlockMaterialEqualTo(c) => c.use_substring_match && c.expected_material == word,
        Check::DoorsPassable(_) => word == "door",
        Check::SingleLevel(c) => c.start_material.as_deref() == Some(word),
        Check::Adjacent(c) => c.substring_match && c.materials.iter().any(|m| m == word),
        Check::MaterialSequenceOrder(c) => c.use_substring_match && c.material_sequence.iter().any(|m| m == word),
        _ => false,
    }
}
