//! Entailment: every check is asked for by a phrase of the prompts, on every track, and what no check measures is said.

use toml::Spanned;

use super::manifest::Edition;
use super::template::{Context, Misfit, Place};
use super::{CheckEntry, Family, SuiteSource};

/// What an agent has been told up to a turn, on each track.
pub(super) struct Told {
    tracks: Vec<(&'static str, String)>,
}

impl Told {
    /// Begins with the preamble, which agents on the track `brief` see.
    pub(super) fn new(edition: &Edition<'_>) -> Self {
        let mut tracks = vec![("specified", String::new())];
        tracks.extend(edition.preamble.as_ref().map(|preamble| ("brief", preamble.clone())));
        Self { tracks }
    }

    /// Adds the prompts of a turn.
    pub(super) fn turn(&mut self, specified: &str, brief: Option<&str>) {
        for ((_, told), prompt) in self.tracks.iter_mut().zip([Some(specified), brief]) {
            told.push(' ');
            told.push_str(prompt.unwrap_or_default());
        }
    }

    /// Returns a fault if the prompts of the track `specified` lack the first phrase that asks for a check, or those of
    /// another track all of them.
    pub(super) fn lacks(&self, check: &CheckEntry, place: &Place, context: &Context) -> Option<Misfit> {
        let misfit = |span, detail| Misfit { place: Place { span, field: place.field.clone() }, detail };
        if check.asked_by.is_empty() {
            let detail = "asked_by: missing; it names the phrases of the prompt that ask for this check".to_owned();
            return Some(misfit(place.span.clone(), detail));
        }
        let mut phrases = Vec::with_capacity(check.asked_by.len());
        for name in &check.asked_by {
            let Some(phrase) = context.get(name.get_ref().as_str()).and_then(|value| value.as_str()) else {
                return Some(misfit(name.span(), format!("asked_by: there is no phrase {:?}", name.get_ref())));
            };
            phrases.push(phrase);
        }
        let asking = |track: usize| if track == 0 { &phrases[..1] } else { &phrases[..] };
        let is_said =
            |track: usize, told: &str| asking(track).iter().any(|phrase| !phrase.is_empty() && told.contains(phrase));
        let mut tracks = self.tracks.iter().enumerate();
        let (place_of_track, (track, _)) = tracks.find(|(i, (_, told))| !is_said(*i, told))?;
        let names: Vec<&str> = check.asked_by.iter().map(|name| name.get_ref().as_str()).collect();
        let names = &names[..asking(place_of_track).len()];
        let detail = format!("asked_by: no prompt of the track {track} has the phrase {}", names.join(" or "));
        Some(misfit(place.span.clone(), detail))
    }

    /// Returns whether the prompts say what is not measured.
    pub(super) fn admits(&self, unmeasured: &str) -> bool {
        self.tracks.first().is_none_or(|(_, told)| told.contains(unmeasured))
    }
}

/// Returns the sentence that tells what is not measured; nothing if all is.
pub(super) fn not_measured(what: &[String]) -> String {
    if what.is_empty() { String::new() } else { format!("Not measured: {}.", what.join("; ")) }
}

/// Renders a table of what asks for each check: family, phrase, check.
#[must_use]
pub fn table(source: &SuiteSource) -> String {
    let mut text = String::from("| family | phrase of the prompt | check |\n|---|---|---|\n");
    for family in &source.families {
        for check in &family.content.checks {
            let phrases: Vec<String> = check
                .asked_by
                .iter()
                .map(|name| phrase(source, family, name))
                .filter(|text| !text.is_empty())
                .collect();
            let args: Vec<String> =
                check.args.iter().map(|(name, value)| format!("{name} = {}", value.get_ref())).collect();
            let args = if args.is_empty() { String::new() } else { format!(" ({})", args.join(", ")) };
            let row = format!("| {} | {} | `{}`{args} |", family.name(), phrases.join(" / "), check.name.get_ref());
            text.push_str(&one_line(&row));
            text.push('\n');
        }
        for unmeasured in &family.content.unmeasured {
            let row = format!("| {} | {} | none: not measured |", family.name(), unmeasured.get_ref());
            text.push_str(&one_line(&row));
            text.push('\n');
        }
    }
    text
}

/// Returns the template of a phrase: of the family, of its first wording that has it, or of the suite.
fn phrase(source: &SuiteSource, family: &Family, name: &Spanned<String>) -> String {
    let name = name.get_ref().as_str();
    let own = family.content.words.get(name).map(|text| text.get_ref().as_str());
    let of_wording =
        || family.content.wordings.iter().find_map(|wording| Some(wording.words.get(name)?.get_ref().as_str()));
    let found = own.or_else(of_wording).or_else(|| source.words.get(name).map(String::as_str));
    format!("**{name}**: {}", found.unwrap_or_default())
}

fn one_line(row: &str) -> String {
    row.split_whitespace().collect::<Vec<_>>().join(" ")
}
