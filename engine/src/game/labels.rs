//! Titles and stack sizes of blocks and items.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::LazyLock;

/// Title of a block or an item in English, and how many of it are one stack.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Title, such as `Block of Gold`.
    pub title: Cow<'static, str>,
    /// Most items of one stack.
    pub stack_size: u16,
}

/// Labels that do not follow from the name, by names; those of blocks alone have a star before it.
static LABELS: LazyLock<HashMap<&'static str, Label, foldhash::fast::RandomState>> = LazyLock::new(|| {
    let label = |line: &'static str| {
        let mut columns = line.splitn(3, ' ');
        let (name, stack_size, title) = (columns.next()?, columns.next()?.parse().ok()?, columns.next()?);
        Some((name, Label { title: Cow::Borrowed(title), stack_size }))
    };
    let lines = include_str!("data/names.txt").lines();
    lines.map(|line| label(line).expect("the table is well-formed, as a test shows")).collect()
});

impl Label {
    /// Returns the label of a block.
    #[must_use]
    pub fn of_block(name: &str) -> Self {
        LABELS.get(format!("*{name}").as_str()).cloned().unwrap_or_else(|| Self::of_item(name))
    }

    /// Returns the label of an item: unless it is listed, its name with a capital for each word, in stacks of 64.
    #[must_use]
    pub fn of_item(name: &str) -> Self {
        LABELS.get(name).cloned().unwrap_or_else(|| {
            let capital = |word: &str| {
                let mut letters = word.chars();
                letters.next().map(|first| first.to_uppercase().chain(letters).collect::<String>()).unwrap_or_default()
            };
            let words: Vec<String> = name.split('_').map(capital).collect();
            Self { title: Cow::Owned(words.join(" ")), stack_size: 64 }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_follow_from_names_or_are_listed() {
        let told = |label: Label| (label.title.into_owned(), label.stack_size);
        assert_eq!(told(Label::of_item("polished_granite")), ("Polished Granite".to_owned(), 64));
        assert_eq!(told(Label::of_item("white_bed")), ("White Bed".to_owned(), 1));
        assert_eq!(told(Label::of_block("lapis_block")), ("Block of Lapis Lazuli".to_owned(), 64));
        assert_eq!(told(Label::of_item("wheat")).0, "Wheat");
        assert_eq!(told(Label::of_block("wheat")).0, "Wheat Crops");
    }
}
