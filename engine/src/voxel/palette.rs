//! Material names, each stored once.

use std::collections::HashMap;
use std::sync::Arc;

/// Index of a material name in its [`Palette`].
pub type MaterialId = u32;

/// The distinct material names of a log, in the order of their first use.
#[derive(Debug, Clone, Default)]
pub struct Palette {
    names: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, MaterialId, foldhash::fast::RandomState>,
}

impl Palette {
    /// An empty palette.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The id of `name`, added at the end if it is new.
    pub fn intern(&mut self, name: &str) -> MaterialId {
        if let Some(&id) = self.ids.get(name) {
            return id;
        }
        let id = MaterialId::try_from(self.names.len()).unwrap_or(MaterialId::MAX);
        let name: Arc<str> = Arc::from(name);
        self.names.push(Arc::clone(&name));
        self.ids.insert(name, id);
        id
    }

    /// The id of `name`, if it has been added.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<MaterialId> {
        self.ids.get(name).copied()
    }

    /// The name with this id; empty for an id that was never given out.
    #[must_use]
    pub fn name(&self, id: MaterialId) -> &str {
        self.names.get(id as usize).map_or("", |name| name)
    }

    /// All names in the order of their ids.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.names.iter().map(|name| &**name)
    }

    /// Number of distinct names.
    #[must_use]
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether no name has been added.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Whether each name, by id, satisfies `wanted`: the test runs once a name, not once a block.
    #[must_use]
    pub fn mask(&self, wanted: impl Fn(&str) -> bool) -> Vec<bool> {
        self.names().map(wanted).collect()
    }
}
