//! Row structs that read each field from the column of the same name.

/// Implements [`super::db::FromRow`] for a struct whose fields are named after columns.
macro_rules! from_row {
    ($row:ident { $($column:ident),+ $(,)? }) => {
        impl $crate::store::db::FromRow for $row {
            fn from_row(row: &$crate::store::db::Row) -> $crate::store::StoreResult<Self> {
                Ok(Self { $($column: row.get(stringify!($column))?),+ })
            }
        }
    };
}

pub(super) use from_row;
