//! Interned material names: each distinct name is stored once.

use std::collections::HashMap;
use std::sync::Arc;

/// Index of a material name in its [`Palette`].
pub type MaterialId = u32;

/// The distinct material names of a log, in order of first use.
#[derive(Debug, Clone, Default)]
pub struct Palette {
    names: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, MaterialId, foldhash::fast::RandomState>,
}

impl Palette {
    /// Creates an empty palette.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the id of `name`, and appends the name if it is new.
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

    /// Returns the id of `name`, or `None` if the name has not been added.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<MaterialId> {
        self.ids.get(name).copied()
    }

    /// Returns the name with this id, or an empty string if no name has it.
    #[must_use]
    pub fn name(&self, id: MaterialId) -> &str {
        self.names.get(id as usize).map_or("", |name| name)
    }

    /// Returns all names in the order of their ids.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.names.iter().map(|name| &**name)
    }

    /// Returns the number of distinct names.
    #[must_use]
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Returns whether the palette holds no names.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Evaluates `wanted` for each name and returns the results by id: the test runs once per name, not once per block.
    #[must_use]
    pub fn mask(&self, wanted: impl Fn(&str) -> bool) -> Vec<bool> {
        self.names().map(wanted).collect()
    }
}
