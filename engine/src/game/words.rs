//! The text of a command, read word by word.

use super::command::Angle;
use super::coordinates::{Coordinates, number};
use super::filter::{Filter, Members};
use super::refusal::Refusal;
use super::registry::{Block, Look};
use super::tags;

/// Name of a block, and the names and values of its properties.
pub type BlockText<'t> = (&'t str, Vec<(&'t str, &'t str)>);

/// The rest of a command's text, of which words are taken from the left.
pub struct Words<'t> {
    /// The text that is left; none at its end.
    pub rest: Option<&'t str>,
}

impl<'t> Words<'t> {
    /// Takes the next word; words are parted by single spaces.
    pub fn next(&mut self, what: &str) -> Result<&'t str, Refusal> {
        let rest = self.rest.ok_or_else(|| Refusal::new(format!("incomplete command: {what} is missing")))?;
        let (word, rest) = rest.split_once(' ').map_or((rest, None), |(word, rest)| (word, Some(rest)));
        self.rest = rest;
        Ok(word)
    }

    /// Takes three coordinates.
    pub fn coordinates(&mut self) -> Result<Coordinates, Refusal> {
        Coordinates::read([self.next("a coordinate")?, self.next("a coordinate")?, self.next("a coordinate")?])
    }

    /// Takes two angles in degrees.
    pub fn rotation(&mut self) -> Result<[Angle; 2], Refusal> {
        Ok([self.angle()?, self.angle()?])
    }

    fn angle(&mut self) -> Result<Angle, Refusal> {
        let word = self.next("an angle")?;
        let (digits, is_relative) = word.strip_prefix('~').map_or((word, false), |rest| (rest, true));
        Ok(Angle { degrees: number(digits)?, is_relative })
    }

    /// Takes the name of a block with its properties, which may contain spaces, and skips its data.
    pub fn block_text(&mut self) -> Result<BlockText<'t>, Refusal> {
        let text = self.rest.ok_or_else(|| Refusal::new("incomplete command: a block is missing"))?;
        let end = text.find([' ', '[', '{']).unwrap_or(text.len());
        let (name, mut after) = text.split_at(end);
        let mut pairs: Vec<(&str, &str)> = Vec::new();
        if let Some(list) = after.strip_prefix('[') {
            let (list, rest) =
                list.split_once(']').ok_or_else(|| Refusal::new("expected closing ] for block state properties"))?;
            for pair in list.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
                let (name, value) = pair
                    .split_once('=')
                    .ok_or_else(|| Refusal::new(format!("expected value for property '{pair}'")))?;
                let (name, value) = (name.trim().trim_matches('"'), value.trim().trim_matches('"'));
                if pairs.iter().any(|(known, _)| *known == name) {
                    return Err(Refusal::new(format!("property '{name}' can only be set once")));
                }
                pairs.push((name, value));
            }
            after = rest;
        }
        if after.starts_with('{') {
            after = after_data(after)?;
        }
        self.rest = match after.strip_prefix(' ') {
            Some(rest) => Some(rest),
            None if after.is_empty() => None,
            None => return Err(Refusal::new(format!("expected a space before '{after}'"))),
        };
        Ok((name, pairs))
    }

    /// Takes a block with its properties.
    pub fn look(&mut self) -> Result<Look, Refusal> {
        let (name, pairs) = self.block_text()?;
        block_named(name)?.state(&pairs).map_err(|error| Refusal::new(error.to_string()))
    }

    /// Takes a block or a tag as a filter.
    pub fn filter(&mut self) -> Result<Filter, Refusal> {
        let text = self.rest.unwrap_or_default();
        let (name, pairs) = self.block_text()?;
        if text[..text.len() - self.rest.unwrap_or_default().len()].contains('{') {
            return Err(Refusal::new("block data in a filter is not simulated; leave it out"));
        }
        let wanted = pairs.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        let members = if let Some(tag) = name.strip_prefix('#') {
            let bare = tag.strip_prefix("minecraft:").unwrap_or(tag);
            let patterns = tags::patterns_of(bare);
            Members::Tag(patterns.ok_or_else(|| Refusal::new(format!("unknown block tag '{tag}'")))?)
        } else {
            let block = block_named(name)?;
            block.state(&pairs).map_err(|error| Refusal::new(error.to_string()))?;
            Members::Block(block.number)
        };
        Ok(Filter { members, wanted })
    }

    /// Checks that nothing is left, or takes one of the words that may follow.
    pub fn option(&mut self, known: &[&'static str]) -> Result<Option<&'static str>, Refusal> {
        if self.rest.is_none() {
            return Ok(None);
        }
        let word = self.next("a mode")?;
        let found = known.iter().find(|known| **known == word);
        found.map(|word| Some(*word)).ok_or_else(|| Refusal::new(format!("incorrect argument '{word}'")))
    }

    /// Checks that nothing is left.
    pub fn end(&self) -> Result<(), Refusal> {
        match self.rest {
            None => Ok(()),
            Some(rest) => Err(Refusal::new(format!("incorrect argument '{rest}'"))),
        }
    }
}

fn block_named(name: &str) -> Result<&'static Block, Refusal> {
    let bare = name.strip_prefix("minecraft:").or_else(|| name.strip_prefix(':')).unwrap_or(name);
    Block::named(bare).ok_or_else(|| Refusal::new(format!("unknown block type '{name}'")))
}

/// Skips block data in braces.
fn after_data(text: &str) -> Result<&str, Refusal> {
    let (mut depth, mut quote, mut is_escaped) = (0_usize, None, false);
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (Some(_), _) if is_escaped => is_escaped = false,
            (Some(_), '\\') => is_escaped = true,
            (Some(open), _) if c == open => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '{') => depth += 1,
            (None, '}') => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Ok(&text[at + c.len_utf8()..]);
        }
    }
    Err(Refusal::new("expected closing } for block data"))
}
