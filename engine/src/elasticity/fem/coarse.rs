//! The coarse level of the preconditioner: groups of neighbouring nodes that move as rigid bodies.
//!
//! A preconditioner of single nodes spreads a load slowly, and hardly resolves the bending of long thin parts. The
//! joint motion of neighbouring nodes is nearly rigid. The equations are therefore also solved directly in the space of
//! the groups' rigid motions, if that takes bounded work.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::element::UNKNOWNS;
use super::system::System;
use crate::elasticity::{Control, Stopped};

/// Greatest number of multiply-adds for the direct solution; more would cost more than they save.
const MAX_WORK: usize = 150_000_000;
/// Least edge of a group, in blocks.
const LEAST_EDGE: i64 = 4;
/// Greatest number of edges tried; the last is about 40,000 blocks.
const MAX_ROUNDS: u32 = 24;
/// Number of rigid motions of a group: three translations and three rotations.
const MOTIONS: usize = 6;
/// Fraction of the diagonal up to which a pivot marks a motion that depends on others.
const DEPENDENT: f64 = 1e-9;

/// Rigid motions of groups of nodes, with the factorised equations among them.
#[derive(Debug)]
pub struct Coarse {
    /// Group of each node; `None` for a held node.
    group: Vec<Option<u32>>,
    /// Position of each node relative to the centroid of its group, in edges of the group.
    arm: Vec<Vector3<f64>>,
    factor: Envelope,
}

impl Coarse {
    /// Groups the free nodes of a system by boxes and by connectivity within each box. Returns `None` if no box size
    /// bounds the work.
    ///
    /// # Errors
    /// Returns an error if `control` stops the computation; it is polled between box sizes.
    pub fn new(system: &System<'_>, control: &Control<'_>) -> Result<Option<Self>, Stopped> {
        let mut edge = LEAST_EDGE;
        let mut rounds = 0;
        let (group, groups, first) = loop {
            let (group, groups) = group_nodes(system, edge);
            let first = first_entries(system, &group, groups);
            let work: usize = first.iter().enumerate().map(|(row, first)| (row - first + 1).pow(2)).sum();
            if work <= MAX_WORK {
                break (group, groups, first);
            }
            rounds += 1;
            if rounds == MAX_ROUNDS {
                return Ok(None);
            }
            control.check(0.0)?;
            edge += edge / 2;
        };
        let mut middle = vec![(Vector3::zeros(), 0.0); groups];
        let place = |node: usize| Vector3::from(system.mesh.position[node].map(f64::from));
        for (node, group) in group.iter().enumerate() {
            if let Some(group) = *group {
                let (sum, count) = &mut middle[group as usize];
                *sum += place(node);
                *count += 1.0;
            }
        }
        let arm = group.iter().enumerate().map(|(node, group)| {
            let (sum, count) = group.map_or((Vector3::zeros(), 1.0), |group| middle[group as usize]);
            (place(node) - sum / count) / edge as f64
        });
        let arm: Vec<Vector3<f64>> = arm.collect();
        let factor = Envelope::of_groups(system, &group, &arm, first);
        Ok(Some(Self { group, arm, factor }))
    }

    /// Adds to `to` the part of the solution for `force` that consists of rigid motions of groups.
    pub fn add_solution(&self, force: &[f64], to: &mut [f64]) {
        let mut pushed = vec![0.0; self.factor.len()];
        for ((group, arm), force) in self.group.iter().zip(&self.arm).zip(force.chunks_exact(3)) {
            let Some(group) = *group else { continue };
            let force = Vector3::new(force[0], force[1], force[2]);
            let turn = arm.cross(&force);
            for k in 0..3 {
                pushed[MOTIONS * group as usize + k] += force[k];
                pushed[MOTIONS * group as usize + 3 + k] += turn[k];
            }
        }
        self.factor.solve(&mut pushed);
        for ((group, arm), to) in self.group.iter().zip(&self.arm).zip(to.chunks_exact_mut(3)) {
            let Some(group) = *group else { continue };
            let motion = &pushed[MOTIONS * group as usize..][..MOTIONS];
            let turned = Vector3::new(motion[3], motion[4], motion[5]).cross(arm);
            for k in 0..3 {
                to[k] += motion[k] + turned[k];
            }
        }
    }
}

/// Returns the group of each free node and the number of groups. Groups are boxes with this edge, split where their
/// nodes are not connected inside, and ordered by boxes along the mesh's longest axis first.
fn group_nodes(system: &System<'_>, edge: i64) -> (Vec<Option<u32>>, usize) {
    let position = &system.mesh.position;
    let along = |k: usize| position.iter().map(move |place| i64::from(place[k]));
    let least = [0, 1, 2].map(|k| along(k).min().unwrap_or(0));
    let mut axes = [0, 1, 2];
    axes.sort_by_key(|&k| std::cmp::Reverse(along(k).max().unwrap_or(0) - least[k]));
    let boxed = |node: usize| axes.map(|k| (i64::from(position[node][k]) - least[k]) / edge);
    let mut parent: Vec<u32> = (0..position.len() as u32).collect();
    for nodes in &system.mesh.nodes {
        for pair in [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (4, 5), (4, 6), (3, 7), (5, 7), (6, 7)] {
            let (a, b) = (nodes[pair.0] as usize, nodes[pair.1] as usize);
            if !system.is_held[a] && !system.is_held[b] && boxed(a) == boxed(b) {
                let (a, b) = (root(&mut parent, a as u32), root(&mut parent, b as u32));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    let mut roots: Vec<u32> = (0..position.len() as u32)
        .filter(|&node| parent[node as usize] == node && !system.is_held[node as usize])
        .collect();
    roots.sort_by_key(|&node| (boxed(node as usize), node));
    let mut number = vec![0; position.len()];
    for (i, &node) in (0u32..).zip(&roots) {
        number[node as usize] = i;
    }
    let group = (0..position.len()).map(|node| {
        let root = root(&mut parent, node as u32);
        (!system.is_held[node]).then(|| number[root as usize])
    });
    (group.collect(), roots.len())
}

fn root(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        parent[node as usize] = parent[parent[node as usize] as usize];
        node = parent[node as usize];
    }
    node
}

/// Returns the groups that a block's nodes belong to, ascending.
fn members(nodes: &[u32; 8], group: &[Option<u32>]) -> Vec<u32> {
    let mut members: Vec<u32> = nodes.iter().filter_map(|&node| group[node as usize]).collect();
    members.sort_unstable();
    members.dedup();
    members
}

/// Returns the column of the first entry in each row of the equations among groups.
fn first_entries(system: &System<'_>, group: &[Option<u32>], groups: usize) -> Vec<usize> {
    let mut least: Vec<usize> = (0..groups).collect();
    for nodes in &system.mesh.nodes {
        let members = members(nodes, group);
        for &member in &members {
            least[member as usize] = least[member as usize].min(members[0] as usize);
        }
    }
    (0..groups * MOTIONS).map(|row| least[row / MOTIONS] * MOTIONS).collect()
}

/// Lower triangular factor that stores each row from its first entry to its diagonal.
#[derive(Debug)]
struct Envelope {
    first: Vec<usize>,
    rows: Vec<Vec<f64>>,
}

impl Envelope {
    fn of_groups(system: &System<'_>, group: &[Option<u32>], arm: &[Vector3<f64>], first: Vec<usize>) -> Self {
        let rows = first.iter().enumerate().map(|(row, first)| vec![0.0; row - first + 1]).collect();
        let mut envelope = Self { first, rows };
        for nodes in &system.mesh.nodes {
            let members = members(nodes, group);
            // A block within one group does not resist its rigid motions.
            if members.is_empty() || members.len() == 1 && nodes.iter().all(|&n| group[n as usize].is_some()) {
                continue;
            }
            let motions: Vec<_> = members.iter().map(|&member| (member, rigid(nodes, group, arm, member))).collect();
            for (a, of_a) in &motions {
                let pulled = system.element.stiffness * of_a * system.edge_m;
                for (b, of_b) in motions.iter().filter(|(b, _)| b <= a) {
                    envelope.add(*a as usize, *b as usize, &(pulled.transpose() * of_b));
                }
            }
        }
        envelope.factorise();
        envelope
    }

    fn add(&mut self, a: usize, b: usize, block: &SMatrix<f64, MOTIONS, MOTIONS>) {
        for i in 0..MOTIONS {
            let row = a * MOTIONS + i;
            for j in 0..MOTIONS {
                let column = b * MOTIONS + j;
                if column <= row {
                    self.rows[row][column - self.first[row]] += block[(i, j)];
                }
            }
        }
    }

    /// Computes the Cholesky factorisation in place. Leaves out motions that depend on others, such as the rotation of
    /// a single node.
    fn factorise(&mut self) {
        for i in 0..self.rows.len() {
            let (done, rest) = self.rows.split_at_mut(i);
            let row = &mut rest[0];
            let first = self.first[i];
            for j in first..i {
                let from = first.max(self.first[j]);
                let other = &done[j];
                let sum = dot(&row[from - first..j - first], &other[from - self.first[j]..j - self.first[j]]);
                let pivot = other[j - self.first[j]];
                row[j - first] = if pivot > 0.0 { (row[j - first] - sum) / pivot } else { 0.0 };
            }
            let (before, diagonal) = row.split_at_mut(i - first);
            let pivot = diagonal[0] - dot(before, before);
            diagonal[0] = if pivot > DEPENDENT * diagonal[0] { pivot.sqrt() } else { 0.0 };
        }
    }

    fn len(&self) -> usize {
        self.rows.len()
    }

    fn solve(&self, vector: &mut [f64]) {
        for (i, row) in self.rows.iter().enumerate() {
            let (before, pivot) = (&row[..row.len() - 1], row[row.len() - 1]);
            let sum = dot(before, &vector[self.first[i]..i]);
            vector[i] = if pivot > 0.0 { (vector[i] - sum) / pivot } else { 0.0 };
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            let (before, pivot) = (&row[..row.len() - 1], row[row.len() - 1]);
            let (earlier, own) = vector.split_at_mut(i);
            own[0] = if pivot > 0.0 { own[0] / pivot } else { 0.0 };
            for (sum, entry) in earlier[self.first[i]..].iter_mut().zip(before) {
                *sum -= entry * own[0];
            }
        }
    }
}

/// Returns the displacements of a block's corners for the rigid motions of one group.
fn rigid(
    nodes: &[u32; 8],
    group: &[Option<u32>],
    arm: &[Vector3<f64>],
    member: u32,
) -> SMatrix<f64, UNKNOWNS, MOTIONS> {
    let mut motions = SMatrix::<f64, UNKNOWNS, MOTIONS>::zeros();
    for (corner, &node) in nodes.iter().enumerate() {
        if group[node as usize] == Some(member) {
            let at = 3 * corner;
            motions.fixed_view_mut::<3, 3>(at, 0).copy_from(&Matrix3::identity());
            // A rotation w displaces a node by w x arm.
            motions.fixed_view_mut::<3, 3>(at, 3).copy_from(&arm[node as usize].cross_matrix().transpose());
        }
    }
    motions
}

/// Returns the inner product, in eight partial sums so that additions do not wait for each other.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}
