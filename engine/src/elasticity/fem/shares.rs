//! Blocks of a mesh in two shares that have no node in common, so that two cores can add up forces at the same time.

/// Least number of blocks that have two shares. Two cores gain little on fewer, as measured.
const LEAST_BLOCKS: usize = 20_000;
/// Number of blocks after which nodes are looked for that no later block has.
const RUN: usize = 64;

/// Numbers of the nodes at a block's corners.
pub type Corners = [u32; 8];

/// Returns the number of blocks from which the others form the second share, if this many blocks have one.
#[must_use]
pub fn half(blocks: usize) -> Option<usize> {
    (blocks >= LEAST_BLOCKS).then_some(blocks / 2)
}

/// Blocks of a mesh, in one or two shares. The nodes of the second begin where those of the first end.
#[derive(Debug)]
pub struct Shares {
    /// First share; the only one of a small structure.
    pub first: Share,
    /// Second share.
    pub second: Option<Share>,
    /// Blocks with nodes of both shares.
    pub between: Vec<Corners>,
}

/// Blocks with nodes of one share only, in runs.
#[derive(Debug)]
pub struct Share {
    /// Number of nodes.
    pub nodes: usize,
    /// Blocks; their nodes are counted from the first of the share.
    pub blocks: Vec<Corners>,
    /// Number of nodes, from the first, that contains all nodes of each run and of those before it.
    pub reached: Vec<usize>,
    /// Number of nodes, from the first, of which no run after each has any, nor a block between the shares.
    pub complete: Vec<usize>,
    /// Greatest number of nodes at a time that have been reached but are not complete.
    pub open: usize,
}

impl Shares {
    /// Divides the blocks of a mesh with this number of nodes, which are numbered in the order of the blocks that have them.
    #[must_use]
    pub fn new(blocks: &[Corners], nodes: usize) -> Self {
        let Some(half) = half(blocks.len()) else {
            return Self { between: Vec::new(), first: Share::new(blocks.to_vec(), nodes, nodes), second: None };
        };
        let (first, later) = blocks.split_at(half);
        let middle = first.iter().flatten().max().map_or(0, |most| most + 1);
        let (mut second, between): (Vec<Corners>, Vec<Corners>) =
            later.iter().partition(|corners| corners.iter().all(|&node| node >= middle));
        second.iter_mut().flatten().for_each(|node| *node -= middle);
        let nodes_between = || between.iter().flatten().copied();
        let open_first = nodes_between().min().map_or(middle, |node| node.min(middle)) as usize;
        let middle_at = middle as usize;
        let second_nodes = nodes - middle_at;
        let open_second = nodes_between().filter(|&node| node >= middle).min();
        let open_second = open_second.map_or(second_nodes, |node| (node - middle) as usize);
        Self {
            first: Share::new(first.to_vec(), middle_at, open_first),
            second: Some(Share::new(second, second_nodes, open_second)),
            between,
        }
    }
}

impl Share {
    /// Takes blocks with this number of nodes, of which those from `between` on are not complete before the blocks between
    /// the shares have been added.
    fn new(blocks: Vec<Corners>, nodes: usize, between: usize) -> Self {
        let runs = blocks.chunks(RUN).map(|run| run.iter().flatten().map(|&node| node as usize));
        let reached = runs.clone().scan(0, |reached, run| {
            *reached = run.max().map_or(*reached, |most| (most + 1).max(*reached));
            Some(*reached)
        });
        let reached: Vec<usize> = reached.collect();
        let mut complete = vec![between; reached.len()];
        for (run, nodes) in runs.enumerate().skip(1).rev() {
            complete[run - 1] = nodes.min().map_or(complete[run], |least| least.min(complete[run]));
        }
        let before = std::iter::once(&0).chain(&complete);
        let most = reached.iter().chain([&nodes]).zip(before).map(|(reached, complete)| reached - complete).max();
        Self { nodes, blocks, reached, complete, open: most.unwrap_or(0) }
    }

    /// Returns the blocks of a run.
    #[must_use]
    pub fn run(&self, run: usize) -> &[Corners] {
        &self.blocks[run * RUN..self.blocks.len().min((run + 1) * RUN)]
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;
    use crate::elasticity::fem::mesh::{Mesh, Supported};
    use crate::voxel::Cell;

    #[test]
    fn nodes_are_complete_when_no_later_block_has_them() {
        let cells: Vec<Cell> = (0..30 * 30 * 30).map(|i| Cell::new(i % 30, i / 30 % 30, i / 900)).collect();
        let mesh = Mesh::new(Supported::of(&cells).cells);
        let shares = Shares::new(&mesh.nodes, mesh.position.len());
        let second = shares.second.as_ref().expect("this many blocks have two shares");
        assert_eq!(shares.first.blocks.len() + second.blocks.len() + shares.between.len(), 27_000);
        assert_eq!(shares.between.len(), 900, "one layer");
        let between = |nodes: Range<usize>| {
            let between = shares.between.iter().flatten().map(|&node| node as usize);
            between.filter(|node| nodes.contains(node)).min().map(|node| node - nodes.start)
        };
        for (share, from) in [(&shares.first, 0), (second, shares.first.nodes)] {
            for run in 0..share.complete.len() {
                let later = (run + 1..share.complete.len()).flat_map(|run| share.run(run)).flatten();
                let later = later.map(|&node| node as usize).chain(between(from..from + share.nodes)).min();
                assert_eq!(share.complete[run], later.unwrap_or(share.nodes), "run {run}");
            }
            // Three layers of 961 nodes, and the nodes of a run.
            assert!(share.open < 3_200, "{}", share.open);
        }
    }
}
