//! Rigid motions of groups.

use nalgebra::Vector3;

use super::partition::Partition;

/// Number of rigid motions: three translations and three rotations.
pub const MOTIONS: usize = 6;

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
