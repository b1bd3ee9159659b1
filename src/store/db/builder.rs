//! Statements that are put together from parts.

use std::fmt::Write as _;

use super::statement::{Columns, Query, Text, Whole};
use super::value::Value;

/// Statement under construction. Its text consists of constants; everything else is bound.
///
/// Parameters are numbered for PostgreSQL only. SQLite keeps the names of numbered ones in a list that it searches for
/// each, so a statement with a thousand of them would spend most of its time there.
#[derive(Debug)]
pub struct Builder {
    sqlite: String,
    postgres: String,
    values: Vec<Value>,
}

impl Builder {
    /// Begins a statement.
    #[must_use]
    pub fn new(text: &'static str) -> Self {
        Self::new_checked(text.to_owned())
    }

    /// Begins a statement whose text was put together from names of the schema.
    #[must_use]
    pub(in crate::store) fn new_checked(text: String) -> Self {
        Self { sqlite: text.clone(), postgres: text, values: Vec::new() }
    }

    /// Appends text.
    pub fn push(&mut self, text: &'static str) -> &mut Self {
        self.sqlite.push_str(text);
        self.postgres.push_str(text);
        self
    }

    /// Appends a parameter and binds its value.
    pub fn push_bind(&mut self, value: impl Into<Value>) -> &mut Self {
        self.values.push(value.into());
        self.sqlite.push('?');
        write!(self.postgres, "${}", self.values.len()).expect("a string takes all text");
        self
    }

    /// Appends `VALUES (…), (…), …`, a row for each item.
    pub fn push_values<T>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut row: impl FnMut(&mut RowValues<'_>, T),
    ) -> &mut Self {
        self.push("VALUES ");
        for (i, item) in items.into_iter().enumerate() {
            self.push(if i == 0 { "(" } else { ", (" });
            row(&mut RowValues { builder: self, is_first: true }, item);
            self.push(")");
        }
        self
    }

    /// Appends `(…, …)`, the values of a list.
    pub fn push_list<V: Into<Value>>(&mut self, values: impl IntoIterator<Item = V>) -> &mut Self {
        self.push("(");
        for (i, value) in values.into_iter().enumerate() {
            if i > 0 {
                self.push(", ");
            }
            self.push_bind(value);
        }
        self.push(")")
    }

    /// Ends a statement that returns whole rows.
    #[must_use]
    pub fn build(self) -> Query<Whole> {
        Query::new(Text::built(self.sqlite, self.postgres), self.values)
    }

    /// Ends a statement whose rows are read as tuples or structs.
    #[must_use]
    pub fn build_as(self) -> Query<Columns> {
        Query::new(Text::built(self.sqlite, self.postgres), self.values)
    }
}

/// Values of a row under construction.
#[derive(Debug)]
pub struct RowValues<'b> {
    builder: &'b mut Builder,
    is_first: bool,
}

impl RowValues<'_> {
    /// Binds the next value.
    pub fn push_bind(&mut self, value: impl Into<Value>) -> &mut Self {
        if !std::mem::take(&mut self.is_first) {
            self.builder.push(", ");
        }
        self.builder.push_bind(value);
        self
    }
}
