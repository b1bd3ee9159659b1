//! Clusters of one level: number, distance and size (`docs/rules.md#shape`; paper, algorithm "Minimum Inter-Cluster
//! Span").

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::checks::{Amount, Finding, Rule, Subject};
use crate::text::counted;
use crate::voxel::Cell;
use crate::voxel::distance::{closest_pair_between, farthest_pair, root};
use crate::voxel::planar::{Clusters, PlaneCell, Touch, level};

/// Check of the number of clusters at a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClusterCountAtY {
    /// The level.
    pub y: i32,
    /// Required number of clusters.
    pub expected_count: Amount,
    /// Whether cells that share only a corner belong to the same cluster.
    #[serde(default)]
    pub use_8_neighbors: bool,
}

/// Check that any two clusters of a level are a distance apart, between the centres of their nearest cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClustersAtYHaveMinSpan {
    /// The level.
    pub y: i32,
    /// Least distance, in cells.
    pub min_span: Amount,
    /// Whether cells that share only a corner belong to the same cluster.
    #[serde(default)]
    pub use_8_neighbors: bool,
}

/// Check that a level has one cluster, which reaches far enough from the mean of its cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClusterAtYHasMinRadius {
    /// The level.
    pub y: i32,
    /// Least distance of the farthest cell from the mean, in cells.
    pub min_radius: Amount,
    /// Whether cells that share only a corner belong to the same cluster.
    #[serde(default)]
    pub use_8_neighbors: bool,
}

/// Check that a level has one cluster, two cells of which are far enough apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClusterAtYHasMinDiameter {
    /// The level.
    pub y: i32,
    /// Least distance between the two farthest cells, in cells.
    pub min_diameter: Amount,
    /// Whether cells that share only a corner belong to the same cluster.
    #[serde(default)]
    pub use_8_neighbors: bool,
}

fn clusters_at(subject: &Subject<'_>, y: i32, use_8_neighbors: bool) -> (Vec<PlaneCell>, Clusters) {
    let cells = level(subject.structure, y);
    let clusters = Clusters::of(&cells, Touch::published(use_8_neighbors));
    (cells, clusters)
}

fn raised(cells: impl IntoIterator<Item = PlaneCell>, y: i32) -> impl Iterator<Item = Cell> {
    cells.into_iter().map(move |(x, z)| Cell::new(x, y, z))
}

impl Rule for ClusterCountAtY {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let (cells, clusters) = clusters_at(subject, self.y, self.use_8_neighbors);
        let holds = clusters.count as f64 == self.expected_count.0;
        let summary = format!(
            "{} at y = {}; required exactly {}",
            counted(clusters.count, "cluster"),
            self.y,
            self.expected_count
        );
        let finding = Finding::binary(holds, clusters.count, json!({ "==": self.expected_count }), summary);
        if holds {
            return finding.vacuous_if(cells.is_empty());
        }
        finding.with_witnesses(raised(clusters.representatives(&cells), self.y), "first cell of a cluster")
    }
}

impl Rule for ClustersAtYHaveMinSpan {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_span }));
        let (cells, clusters) = clusters_at(subject, self.y, self.use_8_neighbors);
        let Some(closest) = closest_pair_between(&cells, &clusters.label) else {
            let summary = subject
                .tell(|| format!("{} at y = {}: no pair to measure", counted(clusters.count, "cluster"), self.y));
            return Finding::binary(true, json!(null), required, summary).vacuous_if(true);
        };
        let span = closest.length();
        let holds = span >= self.min_span.0;
        let summary = subject.tell(|| {
            format!("nearest clusters at y = {} are {span} apart; required at least {}", self.y, self.min_span)
        });
        let finding = Finding::binary(holds, span, required, summary);
        if holds { finding } else { finding.with_witnesses(raised([closest.a, closest.b], self.y), "too near") }
    }
}

/// Returns the finding for a level that must have exactly one cluster and does not.
fn not_one_cluster(y: i32, cells: &[PlaneCell], clusters: &Clusters, required: serde_json::Value) -> Finding {
    let summary = format!("{} at y = {y}; exactly one is required", counted(clusters.count, "cluster"));
    Finding::binary(false, json!(null), required, summary)
        .with_witnesses(raised(clusters.representatives(cells), y), "first cell of a cluster")
}

impl Rule for ClusterAtYHasMinRadius {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_radius }));
        let (cells, clusters) = clusters_at(subject, self.y, self.use_8_neighbors);
        if clusters.count != 1 {
            return not_one_cluster(self.y, &cells, &clusters, required);
        }
        let n = cells.len() as f64;
        let mean_x = cells.iter().map(|c| i64::from(c.0)).sum::<i64>() as f64 / n;
        let mean_z = cells.iter().map(|c| i64::from(c.1)).sum::<i64>() as f64 / n;
        let mut radius = 0.0f64;
        let mut farthest = cells[0];
        for &(x, z) in &cells {
            let (dx, dz) = (f64::from(x) - mean_x, f64::from(z) - mean_z);
            let distance = root(dx * dx + dz * dz);
            if distance > radius {
                (radius, farthest) = (distance, (x, z));
            }
        }
        let holds = radius >= self.min_radius.0;
        let summary =
            subject.tell(|| format!("radius {radius} at y = {}; required at least {}", self.y, self.min_radius));
        let finding = Finding::binary(holds, radius, required, summary);
        if holds { finding } else { finding.with_witnesses(raised([farthest], self.y), "farthest from the mean") }
    }
}

impl Rule for ClusterAtYHasMinDiameter {
    fn evaluate(&self, subject: &Subject<'_>) -> Finding {
        let required = subject.tell(|| json!({ ">=": self.min_diameter }));
        let (cells, clusters) = clusters_at(subject, self.y, self.use_8_neighbors);
        let farthest = farthest_pair(&cells).filter(|_| clusters.count == 1);
        let Some(farthest) = farthest else {
            return not_one_cluster(self.y, &cells, &clusters, required);
        };
        let diameter = farthest.length();
        let holds = diameter >= self.min_diameter.0;
        let summary =
            subject.tell(|| format!("diameter {diameter} at y = {}; required at least {}", self.y, self.min_diameter));
        let finding = Finding::binary(holds, diameter, required, summary);
        if holds { finding } else { finding.with_witnesses(raised([farthest.a, farthest.b], self.y), "farthest apart") }
    }
}
