//! Partitions of nodes or groups into groups.

/// Partition of members, which are nodes or groups of a finer partition.
#[derive(Debug)]
pub struct Partition {
    /// Group of each member; `None` for a held node.
    pub group: Vec<Option<u32>>,
    /// Number of groups.
    pub groups: usize,
}

impl Partition {
    /// Makes a group of these members.
    pub fn begin(&mut self, members: impl Iterator<Item = u32>) {
        for member in members {
            self.group[member as usize] = Some(self.groups as u32);
        }
        self.groups += 1;
    }
}
