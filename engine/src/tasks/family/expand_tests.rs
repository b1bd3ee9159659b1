//! Tests of the expansion of family files.

use super::*;
use crate::voxel::Reading;

#[test]
fn checks_may_depend_on_the_wording() {
    let text = r#"
        family = "walls"
        title = "Walls"
        category = "structural-elements"
        type = "walls"
        description = "A wall."
        instance = "wall"
        [[wordings]]
        name = "one"
        words.material = "stone"
        prompts = ["Raise it."]
        [[wordings]]
        name = "two"
        words.material = "bricks"
        prompts = ["Raise it.", "Raise it further."]
        [[checks]]
        fn = "material.count_is_within"
        args.of = "{{ material }}"
        args.min = 1
        args.max = 9
        [[checks]]
        when = "turn == turns"
        fn = "material.are_blocks_known"
    "#;
    let family = Family::read("walls.toml", text).unwrap();
    let words = BTreeMap::new();
    let edition = Edition {
        version: 1,
        reading: Reading::AsListed,
        words: &words,
        preamble: None,
        every_check_is_asked_for: false,
    };
    let tasks = family.tasks(&family.items(), &edition).unwrap();
    let checks: Vec<Vec<String>> = tasks
        .iter()
        .flat_map(|task| &task.turns)
        .map(|turn| turn.checks.iter().map(|check| serde_json::to_string(check).unwrap()).collect())
        .collect();
    assert_eq!(checks.iter().map(Vec::len).collect::<Vec<_>>(), [2, 1, 2], "{checks:?}");
    let materials = ["stone", "bricks", "bricks"];
    assert!(checks.iter().zip(materials).all(|(checks, material)| checks[0].contains(material)), "{checks:?}");
}
