//! Links of a board page to itself and to the same rows elsewhere.

use crate::app::boards::leaderboard::{CoverageFilter, Direction, RunsListed, SortBy, moment};
use crate::clock::now_ms;
use crate::http::boards::leaderboard::BoardQuery;
use plumbline_engine::tasks::Track;

/// Columns that a board can be sorted by: value, its name in queries, and displayed name.
const COLUMNS: [(SortBy, &str, &str); 11] = [
    (SortBy::Overall, "overall", "overall"),
    (SortBy::Accuracy, "accuracy", "accuracy"),
    (SortBy::Material, "material", "material"),
    (SortBy::Shape, "shape", "shape"),
    (SortBy::Size, "size", "size"),
    (SortBy::PhysicalPlausibility, "physical_plausibility", "plausibility"),
    (SortBy::Dependency, "dependency", "dependency"),
    (SortBy::StructuralStability, "structural_stability", "mean stability"),
    (SortBy::Efficiency, "efficiency", "mean efficiency"),
    (SortBy::Coverage, "coverage", "coverage"),
    (SortBy::Finished, "finished", "finished"),
];
/// A column of the table of all figures.
pub struct Column {
    /// Name in queries.
    pub key: &'static str,
    /// Displayed name.
    pub name: &'static str,
    /// Link to the page sorted by it.
    pub link: String,
}

/// Links of a board page to itself: they keep the filters and the number of rows.
pub struct Links<'q> {
    suite: &'q str,
    sort: SortBy,
    order: Direction,
    filters: Vec<(&'static str, String)>,
    limit: Option<u32>,
}

impl<'q> Links<'q> {
    /// Returns the links of the page of a query.
    pub fn of(suite: &'q str, query: &BoardQuery) -> Self {
        let filters = [
            ("agent", query.agent.clone()),
            ("provenance", query.provenance.map(|provenance| provenance.name().to_owned())),
            ("track", query.track.map(|track| track.name().to_owned())),
            ("coverage", (query.coverage == CoverageFilter::Incomplete).then(|| "incomplete".to_owned())),
            ("runs", (query.runs == RunsListed::BestOfAgent).then(|| "best_of_agent".to_owned())),
            ("as_of", query.as_of.clone()),
        ];
        let filters = filters.into_iter().filter_map(|(name, value)| Some((name, value?))).collect();
        Self { suite, sort: query.sort, order: query.order, filters, limit: query.limit }
    }

    /// Returns whether the page lists only some of the runs. Order and page are no filters.
    pub const fn is_filtered(&self) -> bool {
        !self.filters.is_empty()
    }

    /// Returns the name of the value by which the page is sorted.
    pub fn sort(&self) -> &'static str {
        COLUMNS.iter().find(|(by, ..)| *by == self.sort).map_or("overall", |(_, key, _)| key)
    }

    /// Returns the columns; each links to the page sorted by it, or in the other direction if it is sorted by it.
    pub fn columns(&self) -> Vec<Column> {
        let column = |(by, key, name)| {
            let turned =
                if by == self.sort && self.order == Direction::Desc { Direction::Asc } else { Direction::Desc };
            Column { key, name, link: self.link(key, turned, None) }
        };
        COLUMNS.map(column).into()
    }

    /// Returns the link to the page after the row of a run, or to the first.
    pub fn page(&self, after: Option<&str>) -> String {
        self.link(self.sort(), self.order, after)
    }

    /// Returns the query of these rows in the API, as the beginning of a longer one.
    pub fn rows(&self) -> String {
        form_urlencoded::Serializer::new(self.order_of_rows()).extend_pairs(&self.filters).finish()
    }

    fn order_of_rows(&self) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        if (self.sort(), self.order) != ("overall", Direction::Desc) {
            query.append_pair("sort", self.sort());
            query.extend_pairs((self.order == Direction::Asc).then_some(("order", "asc")));
        }
        query.finish()
    }

    /// Returns whether the page shows the rows of a time that is over, which nothing can change any more.
    pub fn is_past(&self) -> bool {
        let as_of = self.filters.iter().find(|(name, _)| *name == "as_of");
        as_of.is_some_and(|(_, text)| matches!(moment(Some(text)), Ok(Some(at)) if at < now_ms()))
    }

    /// Returns a link that shows these rows as they are at a time.
    pub fn lasting(&self, now: &str) -> String {
        if self.is_past() {
            return format!("/boards/{}?{}", self.suite, self.rows());
        }
        let mut query = form_urlencoded::Serializer::new(self.order_of_rows());
        query.extend_pairs(self.filters.iter().filter(|(name, _)| *name != "as_of"));
        format!("/boards/{}?{}", self.suite, query.append_pair("as_of", now).finish())
    }

    /// Returns a link to the same filters with prompts of a track.
    pub fn of_track(&self, track: Option<Track>) -> String {
        let kept = self.filters.iter().filter(|(name, _)| *name != "track");
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.extend_pairs(track.map(|track| ("track", track.name())));
        let query = query.extend_pairs(kept).finish();
        if query.is_empty() { format!("/boards/{}", self.suite) } else { format!("/boards/{}?{query}", self.suite) }
    }

    /// Returns the query of the charts of these runs: of the filters, those that charts have.
    pub fn charts(&self) -> String {
        let kept = self.filters.iter().filter(|(name, _)| ["track", "as_of"].contains(name));
        form_urlencoded::Serializer::new(String::new()).extend_pairs(kept).finish()
    }

    fn link(&self, sort: &str, order: Direction, after: Option<&str>) -> String {
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.append_pair("sort", sort);
        if order == Direction::Asc {
            query.append_pair("order", "asc");
        }
        query.extend_pairs(&self.filters);
        query.extend_pairs(self.limit.map(|limit| ("limit", limit.to_string())));
        query.extend_pairs(after.map(|after| ("after", after)));
        format!("/boards/{}?{}", self.suite, query.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::extract::params;

    fn query(text: &str) -> BoardQuery {
        params::read(text).unwrap()
    }

    #[test]
    fn links_keep_filters_and_number_of_rows() {
        let filters = "agent=a+b&provenance=re-run-by-host&coverage=incomplete&as_of=2026-11-21T00%3A00%3A00Z&limit=7";
        let shown = query(&format!("{filters}&sort=shape&order=asc&after=x"));
        let links = Links::of("lite", &shown);
        let columns = links.columns();
        assert_eq!(columns[0].link, format!("/boards/lite?sort=overall&{filters}"));
        assert_eq!(columns[3].link, format!("/boards/lite?sort=shape&{filters}"), "the other direction");
        assert_eq!(
            links.lasting("now"),
            format!("/boards/lite?sort=shape&order=asc&{}", filters.replace("&limit=7", ""))
        );
        let today = query("as_of=2999-01-01&agent=a");
        assert_eq!(Links::of("lite", &today).lasting("now"), "/boards/lite?agent=a&as_of=now", "it is not over");
        assert_eq!(links.page(Some("y")), format!("/boards/lite?sort=shape&order=asc&{filters}&after=y"));
        assert!(links.is_filtered());
    }

    #[test]
    fn order_and_page_are_no_filters() {
        let shown = query("sort=finished&order=desc&limit=5&after=x&coverage=complete");
        let links = Links::of("lite", &shown);
        assert!(!links.is_filtered());
        assert_eq!(links.sort(), "finished");
        assert_eq!(links.columns()[10].link, "/boards/lite?sort=finished&order=asc&limit=5");
    }

    #[test]
    fn every_column_has_the_name_of_its_value() {
        for (by, key, _) in COLUMNS {
            assert_eq!(query(&format!("sort={key}")).sort, by);
        }
    }
}
