//! Rows that statements return, and the types that their columns read as.

use sqlx::error::BoxDynError;
use sqlx::postgres::PgRow;
use sqlx::sqlite::SqliteRow;
use sqlx::{ColumnIndex, Decode, Postgres, Row as _, Sqlite, Type};

use crate::store::StoreResult;

/// Row of a result.
#[derive(Debug)]
pub enum Row {
    /// Row of SQLite.
    Sqlite(SqliteRow),
    /// Row of PostgreSQL.
    Postgres(PgRow),
}

impl Row {
    /// Reads a column, by its name or its position from 0.
    ///
    /// # Errors
    /// Returns an error if there is no such column, or if it holds another type.
    pub fn get<'r, T: Column<'r>>(&'r self, index: impl Index) -> StoreResult<T> {
        let raw: Option<T::Raw> = match self {
            Self::Sqlite(row) => row.try_get(index)?,
            Self::Postgres(row) => row.try_get(index)?,
        };
        Ok(T::from_raw(raw).map_err(|source| sqlx::Error::ColumnDecode { index: format!("{index:?}"), source })?)
    }
}

/// Position or name of a column.
pub trait Index: ColumnIndex<SqliteRow> + ColumnIndex<PgRow> + Copy {}

impl<I: ColumnIndex<SqliteRow> + ColumnIndex<PgRow> + Copy> Index for I {}

/// Type that both databases decode.
pub trait Native<'r>: Decode<'r, Sqlite> + Type<Sqlite> + Decode<'r, Postgres> + Type<Postgres> {}

impl<'r, T: Decode<'r, Sqlite> + Type<Sqlite> + Decode<'r, Postgres> + Type<Postgres>> Native<'r> for T {}

/// Type that a column reads as.
pub trait Column<'r>: Sized {
    /// Type that the databases decode.
    type Raw: Native<'r>;

    /// Converts the decoded value; none is a null.
    ///
    /// # Errors
    /// Returns an error if the value is not one of this type.
    fn from_raw(raw: Option<Self::Raw>) -> Result<Self, BoxDynError>;
}

macro_rules! native_column {
    ($($column:ty),+ $(,)?) => {
        $(
            impl<'r> Column<'r> for $column {
                type Raw = Self;

                fn from_raw(raw: Option<Self>) -> Result<Self, BoxDynError> {
                    raw.ok_or_else(|| "unexpected null".into())
                }
            }
        )+
    };
}

native_column!(bool, i64, f64, String, &'r str, Vec<u8>, &'r [u8]);

impl Column<'_> for u32 {
    type Raw = i64;

    fn from_raw(raw: Option<i64>) -> Result<Self, BoxDynError> {
        Ok(Self::try_from(i64::from_raw(raw)?)?)
    }
}

impl<'r, T: Column<'r>> Column<'r> for Option<T> {
    type Raw = T::Raw;

    fn from_raw(raw: Option<T::Raw>) -> Result<Self, BoxDynError> {
        raw.map(|raw| T::from_raw(Some(raw))).transpose()
    }
}

/// Type that a whole row reads as.
pub trait FromRow: Sized {
    /// Reads a row.
    ///
    /// # Errors
    /// Returns an error if a column is missing or holds another type.
    fn from_row(row: &Row) -> StoreResult<Self>;
}

/// Implements [`FromRow`] for tuples, whose fields are the columns in order.
macro_rules! tuple_from_row {
    ($($column:ident $index:literal),+) => {
        impl<$($column: for<'r> Column<'r>),+> FromRow for ($($column,)+) {
            fn from_row(row: &Row) -> StoreResult<Self> {
                Ok(($(row.get::<$column>($index)?,)+))
            }
        }
    };
}

tuple_from_row!(A 0);
tuple_from_row!(A 0, B 1);
tuple_from_row!(A 0, B 1, C 2);
tuple_from_row!(A 0, B 1, C 2, D 3);
tuple_from_row!(A 0, B 1, C 2, D 3, E 4);
tuple_from_row!(A 0, B 1, C 2, D 3, E 4, F 5);
tuple_from_row!(A 0, B 1, C 2, D 3, E 4, F 5, G 6);
tuple_from_row!(A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7);
