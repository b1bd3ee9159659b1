//! Values that statements bind.

/// Value of a parameter. A null has the type of its column, because PostgreSQL asks for it.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Truth value.
    Bool(Option<bool>),
    /// Integer.
    Int(Option<i64>),
    /// Floating-point number.
    Float(Option<f64>),
    /// Text.
    Text(Option<String>),
    /// Bytes.
    Bytes(Option<Vec<u8>>),
}

/// Implements the conversion of a type, and of an option of it.
macro_rules! value_from {
    ($($from:ty => $variant:ident($value:ident) $into:expr),+ $(,)?) => {
        $(
            impl From<$from> for Value {
                fn from($value: $from) -> Self {
                    Self::$variant(Some($into))
                }
            }

            impl From<Option<$from>> for Value {
                fn from(value: Option<$from>) -> Self {
                    Self::$variant(value.map(|$value| $into))
                }
            }
        )+
    };
}

value_from! {
    bool => Bool(value) value,
    i64 => Int(value) value,
    i32 => Int(value) i64::from(value),
    u32 => Int(value) i64::from(value),
    &i64 => Int(value) *value,
    &u32 => Int(value) i64::from(*value),
    f64 => Float(value) value,
    String => Text(value) value,
    &String => Text(value) value.clone(),
    &str => Text(value) value.to_owned(),
    Vec<u8> => Bytes(value) value,
    &[u8] => Bytes(value) value.to_owned(),
}

impl From<&Option<String>> for Value {
    fn from(value: &Option<String>) -> Self {
        Self::Text(value.clone())
    }
}
