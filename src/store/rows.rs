//! Row structs that read each field from the column of the same name.

/// Implements [`sqlx::FromRow`] for a struct whose fields are named after columns.
///
/// This does what sqlx's derive does. The derive would compile sqlx and SQLite a second time, for the compiler's own use.
macro_rules! from_row {
    ($row:ident { $($column:ident),+ $(,)? }) => {
        impl<'r> sqlx::FromRow<'r, sqlx::sqlite::SqliteRow> for $row {
            fn from_row(row: &'r sqlx::sqlite::SqliteRow) -> Result<Self, sqlx::Error> {
                use sqlx::Row as _;
                Ok(Self { $($column: row.try_get(stringify!($column))?),+ })
            }
        }
    };
}

pub(super) use from_row;
