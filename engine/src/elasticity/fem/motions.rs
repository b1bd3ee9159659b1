//! Rigid motions of groups.

use std::ops::Range;

use nalgebra::Vector3;

use super::partition::Partition;
use super::vectors::add;
use crate::elasticity::Control;

/// Number of rigid motions: three translations and three rotations.
pub const MOTIONS: usize = 6;
/// Least number of members that are worth two cores.
const LEAST_MEMBERS: usize = 20_000;

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

    /// Returns forces and moments on the groups for those on their members. The numbers do not depend on whether `control`
    /// lends cores.
    #[must_use]
    pub fn gathered(&self, control: &Control<'_>, force: &[f64]) -> Vec<f64> {
        let members = self.group.len();
        let middle = if members < LEAST_MEMBERS { members } else { members / 2 };
        let (first, second) = force.split_at(N * middle);
        let mut sums = vec![0.0; MOTIONS * self.middle.len()];
        if middle == members {
            self.gather(0..members, first, &mut sums);
            return sums;
        }
        let mut others = vec![0.0; sums.len()];
        control.both(|| self.gather(0..middle, first, &mut sums), || self.gather(middle..members, second, &mut others));
        add(1.0, &others, &mut sums);
        sums
    }

    /// Adds forces and moments of some members to those on their groups.
    fn gather(&self, members: Range<usize>, force: &[f64], sums: &mut [f64]) {
        let members = self.group[members.clone()].iter().zip(&self.arm[members]);
        for ((group, arm), force) in members.zip(force.chunks_exact(N)) {
            let Some(group) = *group else { continue };
            let turn = arm.cross(&Vector3::new(force[0], force[1], force[2]));
            let sums = &mut sums[MOTIONS * group as usize..][..MOTIONS];
            for (sum, part) in sums.iter_mut().zip(force) {
                *sum += part;
            }
            for (sum, part) in sums[3..].iter_mut().zip(turn.iter()) {
                *sum += part;
            }
        }
    }

    /// Writes the motions of some members by those of their groups; zeros for members of no group.
    #[inline]
    pub fn move_members(&self, motion: &[f64], members: Range<usize>, to: &mut [f64]) {
        let members = self.group[members.clone()].iter().zip(&self.arm[members]);
        for ((group, arm), to) in members.zip(to.chunks_exact_mut(N)) {
            let Some(group) = *group else {
                to.fill(0.0);
                continue;
            };
            let motion = &motion[MOTIONS * group as usize..][..MOTIONS];
            to.copy_from_slice(&motion[..N]);
            // A rotation w displaces a member by w x arm.
            let turned = Vector3::new(motion[3], motion[4], motion[5]).cross(arm);
            for (to, part) in to.iter_mut().zip(turned.iter()) {
                *to += part;
            }
        }
    }

    /// Writes the motions of all members by those of their groups.
    pub fn move_all(&self, control: &Control<'_>, motion: &[f64], to: &mut [f64]) {
        let members = self.group.len();
        if members < LEAST_MEMBERS {
            return self.move_members(motion, 0..members, to);
        }
        let middle = members / 2;
        let (first, second) = to.split_at_mut(N * middle);
        control.both(
            || self.move_members(motion, 0..middle, first),
            || self.move_members(motion, middle..members, second),
        );
    }
}
