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

    /// Numbers the groups in the order of their first members: vectors of groups are then read as those of members are.
    pub fn renumber(&mut self) {
        let mut number = vec![None; self.groups];
        let mut next = 0;
        for group in self.group.iter_mut().flatten() {
            *group = *number[*group as usize].get_or_insert_with(|| {
                next += 1;
                next - 1
            });
        }
    }
}
