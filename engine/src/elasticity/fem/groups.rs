//! Groups of neighbouring nodes that move nearly as rigid bodies, and groups of such groups.

use nalgebra::Vector3;

use super::block_matrix::BlockMatrix;
use super::partition::Partition;
use super::system::System;

/// Least number of free nodes of a block that begins a group: four corners of a face have six independent motions.
const LEAST_NODES: usize = 4;

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
        partition.renumber();
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
}
