//! Statements for both databases: SQLite and PostgreSQL.
//!
//! Most statements read the same in both, and stand once. Where they differ, [`Each`] holds both texts side by side.
//! Values, rows and transactions have one type for both databases, so that the rest of the store is written once. The
//! text of a statement numbers its parameters (`$1`, `$2`, …), which both databases understand.

mod builder;
mod pool;
mod row;
mod statement;
mod value;

pub use builder::{Builder, RowValues};
pub use pool::{Dialect, Pool, Tx};
pub use row::{Column, FromRow, Row};
pub use statement::{Each, Text, query, query_as, query_scalar};
pub use value::Value;
