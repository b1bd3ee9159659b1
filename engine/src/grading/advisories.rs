//! Advisories: warnings that help to read the scores of a report (`docs/rules.md#advisories`). They never change a
//! score.

use super::advisory::{Advisory, AdvisoryCode};
use super::report::TurnReport;
use crate::checks::Check;
use crate::tasks::Instruction;
use crate::text::agreeing;
use crate::voxel::replay::{Replay, placed_and_gone};
use crate::voxel::{BlockLog, Cell, CellSet, Event, Structure, blocks};

/// Pairs of a required word and the word for other blocks whose spelling happens to contain it.
const LOOKALIKES: [(&str, &str); 6] = [
    ("bed", "bedrock"),
    ("bed", "embedded"),
    ("door", "trapdoor"),
    ("red", "redstone"),
    ("oak", "dark_oak"),
    ("stone", "cobblestone"),
];

/// Adds the advisories on one turn to `advisories`.
pub fn advise(structure: &Structure, instruction: &Instruction, report: &TurnReport, advisories: &mut Vec<Advisory>) {
    let mut add = |code, check: Option<usize>, detail: String| {
        let check = check.and_then(|c| u32::try_from(c).ok());
        advisories.push(Advisory { code, turn: report.turn, check, detail });
    };
    if structure.is_empty() {
        add(AdvisoryCode::EmptyStructure, None, "the structure is empty: no blocks stand".to_owned());
    } else if structure.cells().iter().all(|cell| cell.y <= 0) && !belongs_in_ground(instruction, report) {
        add(AdvisoryCode::EntirelyInGround, None, "every block is at y <= 0; none stands above that level".to_owned());
    }
    let repeated = structure.len() - structure.distinct_cells();
    if repeated > 0 {
        let blocks = agreeing(repeated, "block repeats", "blocks repeat");
        add(AdvisoryCode::RepeatedCell, None, format!("{blocks} a cell that is already listed"));
    }
    let standing = standing_names(structure);
    if standing
        .iter()
        .any(|name| matches!(name.strip_prefix("minecraft:").unwrap_or(name), "air" | "cave_air" | "void_air"))
    {
        add(AdvisoryCode::AirPlaced, None, "air was placed; the checks count it as a block".to_owned());
    }
    let prefixed = standing.iter().filter(|name| name.starts_with("minecraft:")).count();
    if prefixed > 0 {
        let detail = format!("{prefixed} material names start with \"minecraft:\"; exact comparisons do not strip it");
        add(AdvisoryCode::NamespacedNames, None, detail);
    }
    let unknown: Vec<&str> = standing.iter().copied().filter(|name| !blocks::is_known(name)).collect();
    if !unknown.is_empty() {
        let detail = format!("Minecraft {} has no blocks named {}", blocks::GAME_VERSION, unknown.join(", "));
        add(AdvisoryCode::UnknownBlock, None, detail);
    }
    for (i, check) in report.checks.iter().enumerate() {
        if check.finding.vacuous {
            let detail = format!("{} passed, but there was nothing to check: {}", check.name, check.finding.summary);
            add(AdvisoryCode::HeldVacuously, Some(i), detail);
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
                let detail = format!("{} found {wanted:?} only as part of {family:?}", check.name());
                add(AdvisoryCode::LookalikeMaterial, Some(i), detail);
            }
        }
    }
}

/// Returns whether a turn asks for blocks at or below y = 0, like those of a foundation, and got what it asked for, by the
/// criteria that decide whether a problem passes.
fn belongs_in_ground(instruction: &Instruction, report: &TurnReport) -> bool {
    let asks = |check: &Check| match check {
        Check::LevelHas(level) => {
            level.y <= 0 && (level.min_blocks > 0 || level.min_parts > 0 || level.min_size.is_some())
        }
        _ => false,
    };
    let mut deciding = report.checks.iter().filter(|check| check.criterion.decides());
    instruction.checks.iter().any(asks) && deciding.all(|check| check.finding.holds())
}

/// Adds an advisory for each turn that removes blocks which it placed: under `published` that has no effect.
pub fn advise_on_removals(log: &BlockLog, advisories: &mut Vec<Advisory>) {
    if !log.profile.is_published() {
        return advise_on_published(log, advisories);
    }
    // Cells that a turn both places and removes. Most logs have none, and need no replay.
    let both: Vec<CellSet> = log.turns.iter().map(|events| placed_and_removed(events)).collect();
    if both.iter().all(CellSet::is_empty) {
        return;
    }
    let mut before: Option<Structure> = None;
    for ((turn, both), after) in (1..).zip(both).zip(Replay::new(log)) {
        let stood = |cell| before.as_ref().is_some_and(|before| before.contains(cell));
        let without: Vec<Cell> = both.into_iter().filter(|cell| !stood(*cell)).collect();
        if !without.is_empty() {
            let removals = agreeing(without.len(), "removal has", "removals have");
            let detail = format!(
                "{removals} no effect: the same turn placed the block, and a removal reaches only blocks of earlier turns"
            );
            advisories.push(Advisory { code: AdvisoryCode::RemovalWithoutEffect, turn, check: None, detail });
        }
        before = Some(after);
    }
}

/// Adds an advisory for each turn that ends without blocks which it placed: under `published` they would stand.
fn advise_on_published(log: &BlockLog, advisories: &mut Vec<Advisory>) {
    for (turn, events) in (1..).zip(&log.turns) {
        let gone = placed_and_gone(events.iter().map(|event| (event.cell(), matches!(event, Event::Place { .. }))));
        if gone > 0 {
            let blocks = agreeing(gone, "block is", "blocks are");
            let detail = format!(
                "{blocks} gone because the turn that placed them removed them; under published, where a removal reaches only \
                 blocks of earlier turns, they would stand"
            );
            advisories.push(Advisory { code: AdvisoryCode::DiffersFromPublished, turn, check: None, detail });
        }
    }
}

/// Returns the cells that a turn both places and removes.
fn placed_and_removed(events: &[Event]) -> CellSet {
    let is_place = |event: &&Event| matches!(event, Event::Place { .. });
    let removed: CellSet = events.iter().filter(|event| !is_place(event)).map(Event::cell).collect();
    if removed.is_empty() {
        return removed;
    }
    events.iter().filter(is_place).map(Event::cell).filter(|cell| removed.contains(cell)).collect()
}

/// Returns the distinct names of the blocks that stand.
fn standing_names(structure: &Structure) -> Vec<&str> {
    let mut stands = vec![false; structure.palette().len()];
    for &id in structure.material_ids() {
        stands[id as usize] = true;
    }
    structure.palette().names().zip(stands).filter(|(_, stands)| *stands).map(|(name, _)| name).collect()
}

/// Returns whether the check requires `word` and accepts it as part of a longer name.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::Profile;

    #[test]
    fn a_turn_that_removes_what_it_placed_is_told_under_both_profiles() {
        let mut log = BlockLog::default();
        let [kept, gone] = [Cell::new(0, 0, 0), Cell::new(1, 0, 0)];
        log.place(kept, "stone");
        log.place(gone, "stone");
        log.remove(gone);
        // Placed again, it stands under both.
        log.remove(kept);
        log.place(kept, "stone");
        let told = |log: &BlockLog| {
            let mut advisories = Vec::new();
            advise_on_removals(log, &mut advisories);
            advisories.into_iter().map(|own| (own.code, own.turn)).collect::<Vec<_>>()
        };
        assert_eq!(told(&log), [(AdvisoryCode::RemovalWithoutEffect, 1)]);
        log.profile = Profile::Mindcraft;
        assert_eq!(told(&log), [(AdvisoryCode::DiffersFromPublished, 1)]);
        log.place(gone, "dirt");
        assert_eq!(told(&log), []);
    }
}
