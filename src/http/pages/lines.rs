//! Rows of boards as pages show them: the figures of a run with what its card declares, among results that others
//! report.

use super::html;
use crate::app::App;
use crate::app::boards::leaderboard::Row;
use crate::app::cards::card::{Card, Openness};
use crate::app::cards::of_runs;
use crate::app::error::AppResult;
use crate::http::boards::body::BoardRow;
use plumbline_engine::grading::summary::{Graded, PerCriterion, ProblemRate};
use plumbline_engine::tasks::reported::ReportedRow;

/// Line of a board: a run, or a result that others report.
pub enum Line {
    /// A finished run.
    Run(Box<RunLine>),
    /// A result that was not graded by this service.
    Reported {
        /// Name of the agent, or of the people.
        agent: String,
        /// Rate of solved problems.
        overall: f64,
    },
}

/// A finished run.
pub struct RunLine {
    /// Its row.
    pub row: BoardRow,
    /// What is known of it in a few words: model, owner, openness.
    pub about: String,
    /// Its cost, if its card declares it.
    pub cost: Option<String>,
    /// Number of earlier runs of other owners that it is nearly identical to.
    pub copied_from: usize,
    /// Whether it begins a group: its best possible rank is worse than every one that a run above it may have.
    pub begins_group: bool,
    /// Whether its row was hidden or withdrawn after the time of the board.
    pub is_gone: bool,
}

/// A criterion of a run: its name, its abbreviation and its value.
pub struct Part {
    /// Name of the criterion.
    pub name: &'static str,
    /// Share of problems that pass, or mean score.
    pub value: Option<f64>,
}

impl RunLine {
    /// Returns the seven criteria.
    pub fn parts(&self) -> [Part; 7] {
        criteria(&self.row.problems, &self.row.graded)
    }

    /// Returns how many problems the run answered.
    pub fn answered(&self) -> u64 {
        self.row.overall.of.saturating_sub(self.row.skipped as u64)
    }

    /// Returns the bounds of the interval in percent; empty without one.
    pub fn bounds(&self) -> String {
        html::bounds(self.row.interval)
    }
}

impl Part {
    /// Returns the value as a whole percentage.
    pub fn percent(&self) -> String {
        self.value.map_or_else(|| "–".to_owned(), |value| format!("{:.0}", value * 100.0))
    }
}

/// Returns the seven criteria of a run: shares of problems that pass, and for stability and efficiency mean scores.
pub fn criteria(problems: &PerCriterion<ProblemRate>, graded: &Graded) -> [Part; 7] {
    let part = |name, value| Part { name, value };
    [
        part("material", problems.material.rate),
        part("shape", problems.shape.rate),
        part("size", problems.size.rate),
        part("plausibility", problems.physical_plausibility.rate),
        part("stability", graded.stress.mean),
        part("efficiency", graded.efficiency.mean),
        part("dependency", problems.dependency.rate),
    ]
}

/// Returns whether any run on the lines declares its cost.
pub fn has_cost(lines: &[Line]) -> bool {
    lines.iter().any(|line| matches!(line, Line::Run(run) if run.cost.is_some()))
}

/// Puts what cards declare beside rows of a board.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn lines(app: &App, rows: Vec<Row>) -> AppResult<Vec<Line>> {
    let runs: Vec<String> = rows.iter().map(|row| row.standing.run.clone()).collect();
    let runs: Vec<&str> = runs.iter().map(String::as_str).collect();
    let mut cards = of_runs(app, &runs).await?;
    let is_one_track = rows.windows(2).all(|two| two[0].standing.track == two[1].standing.track);
    // The greatest rank that a run above may have.
    let mut above: Option<usize> = None;
    let line = |row: Row| {
        let owner = row.standing.owner.clone().filter(|_| row.standing.anonymous_until_ms.is_none());
        let card = cards.remove(&row.standing.run).unwrap_or_default();
        let places = row.places.filter(|_| is_one_track);
        let begins_group = above.zip(places).is_some_and(|(above, own)| own.first > above);
        above = above.max(places.map(|places| places.last));
        let prompts = (!is_one_track).then(|| format!("{} prompts", row.standing.track.name()));
        let cost = card.cost.as_ref().map(|cost| format!("{} {}", money(cost.amount), cost.currency));
        let copied_from = row.copied_from;
        Line::Run(Box::new(RunLine {
            about: about(&card, owner, prompts),
            cost,
            copied_from,
            begins_group,
            is_gone: false,
            row: row.into(),
        }))
    };
    Ok(rows.into_iter().map(line).collect())
}

/// Puts reported results among lines, by their rates.
pub fn with_reported(mut lines: Vec<Line>, reported: &[ReportedRow]) -> Vec<Line> {
    for row in reported {
        let rate = match (row.solved.zip(row.of), row.overall) {
            (Some((solved, of)), _) if of > 0 => solved as f64 / of as f64,
            (_, Some(percent)) => percent / 100.0,
            _ => continue,
        };
        let rate_of = |line: &Line| match line {
            Line::Run(run) => run.row.overall.rate.unwrap_or(-1.0),
            Line::Reported { overall, .. } => *overall,
        };
        let at = lines.iter().position(|line| rate_of(line) < rate).unwrap_or(lines.len());
        lines.insert(at, Line::Reported { agent: row.agent.clone(), overall: rate });
    }
    lines
}

fn about(card: &Card, owner: Option<String>, prompts: Option<String>) -> String {
    let model = card.model.as_ref();
    let openness = model.and_then(|model| model.openness).map(|openness| match openness {
        Openness::OpenSource => "open source".to_owned(),
        Openness::OpenWeights => "open weights".to_owned(),
        Openness::Closed => "closed".to_owned(),
    });
    let name = model.and_then(|model| model.name.clone());
    [prompts, name, owner, openness].into_iter().flatten().collect::<Vec<_>>().join(" · ")
}

/// Writes an amount of money: cents where they matter.
pub fn money(amount: f64) -> String {
    match amount {
        amount if amount >= 100.0 => format!("{amount:.0}"),
        amount if amount >= 0.01 => format!("{amount:.2}"),
        // An amount is never shown as nothing.
        amount => amount.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reported_results_stand_where_their_rates_are() {
        let row = |agent: &str, solved, overall| ReportedRow {
            agent: agent.to_owned(),
            solved,
            of: solved.map(|_| 100),
            overall,
            means: Vec::new(),
            spreads: Vec::new(),
        };
        let rows = [
            row("b", Some(40), None),
            row("unknown", None, None),
            row("a", None, Some(90.0)),
            row("c", Some(10), None),
        ];
        let told: Vec<(String, f64)> = with_reported(Vec::new(), &rows)
            .into_iter()
            .filter_map(|line| match line {
                Line::Reported { agent, overall } => Some((agent, overall)),
                Line::Run(_) => None,
            })
            .collect();
        assert_eq!(told, [("a".to_owned(), 0.9), ("b".to_owned(), 0.4), ("c".to_owned(), 0.1)]);
    }

    #[test]
    fn cards_are_told_in_a_few_words() {
        let card = serde_json::json!({ "model": { "name": "m-7b", "openness": "open-weights" } });
        let card: Card = serde_json::from_value(card).unwrap();
        assert_eq!(about(&card, Some("lab".to_owned()), None), "m-7b · lab · open weights");
        assert_eq!(about(&Card::default(), None, Some("brief prompts".to_owned())), "brief prompts");
        assert_eq!([money(0.5), money(123.4), money(0.0004)], ["0.50", "123", "0.0004"]);
    }
}
