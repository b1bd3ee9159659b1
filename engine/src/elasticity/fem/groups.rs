//! Groups of neighbouring nodes that move nearly as rigid bodies, and groups of such groups.

use nalgebra::Vector3;

use super::block_matrix::BlockMatrix;
use super::system::System;

/// Number of rigid motions: three translations and three rotations.
pub const MOTIONS: usize = 6;
/// Least number of free nodes of a block that begins a group: four corners of a face have six independent motions.
const LEAST_NODES: usize = 4;

/// Partition of members, which are nodes or groups of a finer partition.
#[derive(Debug)]
pub struct Partition {
    /// Group of each member; `None` for a held node.
    pub group: Vec<Option<u32>>,
    /// Number of groups.
    pub groups: usize,
}

impl Partition {
    /// Groups the free nodes of a system around blocks that share none. A whole block resists all but rigid motions, so
    /// what the groups cannot follow is stiff.
    #[must_use]
    pub fn of_nodes(system: &System<'_>) -> Self {
        let mesh = system.mesh;
        let mut order: Vec<usize> = (0..mesh.nodes.len()).collect();
        order.sort_unstable_by_key(|&block| mesh.cells[block]);
        let mut partition = Self { group: vec![None; mesh.position.len()], groups: 0 };
        let free = |block: usize| mesh.nodes[block].into_iter().filter(|&node| !system.is_held[node as usize]);
        for &block in &order {
            if free(block).count() >= LEAST_NODES && free(block).all(|node| partition.group[node as usize].is_none()) {
                partition.begin(free(block));
            }
        }
        // The rest joins the group that has most corners of one of its blocks.
        loop {
            let mut joined: Vec<(u32, u32)> = Vec::new();
            for &block in &order {
                let mut present: Vec<u32> = free(block).filter_map(|node| partition.group[node as usize]).collect();
                if present.is_empty() {
                    continue;
                }
                present.sort_unstable();
                let runs = present.chunk_by(|a, b| a == b);
                let Some(most) = runs.max_by_key(|run| (run.len(), std::cmp::Reverse(run[0]))) else { continue };
                let rest = free(block).filter(|&node| partition.group[node as usize].is_none());
                joined.extend(rest.map(|node| (node, most[0])));
            }
            if joined.is_empty() {
                break;
            }
            for (node, group) in joined {
                partition.group[node as usize].get_or_insert(group);
            }
        }
        for &block in &order {
            let rest: Vec<u32> = free(block).filter(|&node| partition.group[node as usize].is_none()).collect();
            if !rest.is_empty() {
                partition.begin(rest.into_iter());
            }
        }
        partition
    }

    /// Groups the unknowns of `matrix`: one with its neighbours, where none of them is in a group yet; each of the rest
    /// with the neighbour that it is tied to most.
    #[must_use]
    pub fn of_groups(matrix: &BlockMatrix) -> Self {
        let mut partition = Self { group: vec![None; matrix.len()], groups: 0 };
        for member in 0..matrix.len() {
            if matrix.row(member).all(|(neighbour, _)| partition.group[neighbour].is_none()) {
                partition.begin(matrix.row(member).map(|(neighbour, _)| neighbour as u32));
            }
        }
        let first = partition.group.clone();
        for member in 0..matrix.len() {
            if partition.group[member].is_some() {
                continue;
            }
            let tie = |block: &nalgebra::Matrix6<f64>| block.fixed_view::<3, 3>(0, 0).norm_squared();
            let strongest = matrix
                .row(member)
                .filter_map(|(neighbour, block)| Some((first[neighbour]?, tie(block))))
                .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            match strongest {
                Some((group, _)) => partition.group[member] = Some(group),
                None => partition.begin(std::iter::once(member as u32)),
            }
        }
        partition
    }

    /// Joins groups whose middles are in one box with this edge, in blocks, and which are tied there.
    #[must_use]
    pub fn of_boxes(matrix: &BlockMatrix, middle: &[Vector3<f64>], edge: f64) -> Self {
        let boxed: Vec<[i64; 3]> =
            middle.iter().map(|middle| [0, 1, 2].map(|k| (middle[k] / edge).floor() as i64)).collect();
        let mut partition = Self { group: vec![None; matrix.len()], groups: 0 };
        for first in 0..matrix.len() {
            if partition.group[first].is_some() {
                continue;
            }
            let mut open = vec![first];
            while let Some(member) = open.pop() {
                if partition.group[member].is_none() {
                    partition.group[member] = Some(partition.groups as u32);
                    open.extend(matrix.row(member).map(|(next, _)| next).filter(|&next| boxed[next] == boxed[first]));
                }
            }
            partition.groups += 1;
        }
        partition
    }

    fn begin(&mut self, members: impl Iterator<Item = u32>) {
        for member in members {
            self.group[member as usize] = Some(self.groups as u32);
        }
        self.groups += 1;
    }

    /// Returns the members of each group, ascending.
    #[must_use]
    pub fn members(&self) -> Vec<Vec<u32>> {
        let mut members = vec![Vec::new(); self.groups];
        for (member, group) in (0..).zip(&self.group) {
            if let Some(group) = group {
                members[*group as usize].push(member);
            }
        }
        members
    }
}

/// Rigid motions of groups as motions of their members, which have `N` unknowns: the displacement of a node, or
/// displacement and rotation of a group.
#[derive(Debug)]
pub struct Motions<const N: usize> {
    /// Group of each member.
    pub group: Vec<Option<u32>>,
    /// Position of each member relative to the middle of its group, in blocks.
    pub arm: Vec<Vector3<f64>>,
    /// Middle of each group, in blocks.
    pub middle: Vec<Vector3<f64>>,
}

impl<const N: usize> Motions<N> {
    /// Describes the motions of the groups of a partition, whose members have these positions.
    #[must_use]
    pub fn new(partition: Partition, position: &[Vector3<f64>]) -> Self {
        let mut sums = vec![(Vector3::zeros(), 0.0); partition.groups];
        for (group, position) in partition.group.iter().zip(position) {
            if let Some(group) = group {
                let (sum, count) = &mut sums[*group as usize];
                *sum += position;
                *count += 1.0;
            }
        }
        let middle: Vec<Vector3<f64>> = sums.into_iter().map(|(sum, count)| sum / count).collect();
        let arm = |(group, position): (&Option<u32>, &Vector3<f64>)| {
            group.map_or_else(Vector3::zeros, |group| position - middle[group as usize])
        };
        let arm = partition.group.iter().zip(position).map(arm).collect();
        Self { group: partition.group, arm, middle }
    }

    /// Returns the motions of the groups of these groups as motions of the same members.
    #[must_use]
    pub fn joined(self, coarser: &Motions<MOTIONS>) -> Self {
        let (group, arm) = self
            .group
            .iter()
            .zip(&self.arm)
            .map(|(group, arm)| match group {
                Some(group) => (coarser.group[*group as usize], arm + coarser.arm[*group as usize]),
                None => (None, *arm),
            })
            .unzip();
        Self { group, arm, middle: coarser.middle.clone() }
    }

    /// Returns forces and moments on the groups for those on their members.
    #[must_use]
    pub fn gathered(&self, force: &[f64]) -> Vec<f64> {
        let mut gathered = vec![0.0; MOTIONS * self.middle.len()];
        for ((group, arm), force) in self.group.iter().zip(&self.arm).zip(force.chunks_exact(N)) {
            let Some(group) = *group else { continue };
            let turn = arm.cross(&Vector3::new(force[0], force[1], force[2]));
            let sums = &mut gathered[MOTIONS * group as usize..][..MOTIONS];
            for (sum, part) in sums.iter_mut().zip(force) {
                *sum += part;
            }
            for (sum, part) in sums[3..].iter_mut().zip(turn.iter()) {
                *sum += part;
            }
        }
        gathered
    }

    /// Adds the motions of the groups to those of their members.
    pub fn add_to_members(&self, motion: &[f64], to: &mut [f64]) {
        for ((group, arm), to) in self.group.iter().zip(&self.arm).zip(to.chunks_exact_mut(N)) {
            let Some(group) = *group else { continue };
            let motion = &motion[MOTIONS * group as usize..][..MOTIONS];
            for (to, part) in to.iter_mut().zip(motion) {
                *to += part;
            }
            // A rotation w displaces a member by w x arm.
            let turned = Vector3::new(motion[3], motion[4], motion[5]).cross(arm);
            for (to, part) in to.iter_mut().zip(turned.iter()) {
                *to += part;
            }
        }
    }
}
