//! The one error type: which argument, what was expected, what came.

use std::fmt::{self, Display};

/// The category of an error; decides the Python exception.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `ValueError`: shape, range or a combination of arguments.
    Value,
    /// `TypeError`: wrong element type.
    Type,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    pub kind: Kind,
    message: String,
}

pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// `argument: expected …, got …` as a `ValueError`.
    pub fn value(argument: &str, expected: impl Display, got: impl Display) -> Self {
        Self {
            kind: Kind::Value,
            message: format!("{argument}: expected {expected}, got {got}"),
        }
    }

    /// `argument: expected …, got …` as a `TypeError`.
    pub fn wrong_type(argument: &str, expected: impl Display, got: impl Display) -> Self {
        Self {
            kind: Kind::Type,
            ..Self::value(argument, expected, got)
        }
    }

    /// `argument` was given without `other`, which it depends on.
    pub fn needs(argument: &str, other: &str) -> Self {
        Self {
            kind: Kind::Value,
            message: format!("{argument}: needs {other} as well"),
        }
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Error {}

/// `Ok` if `value` passes `holds`; `expected` describes that range in the message. A range test written as a comparison
/// refuses NaN.
pub fn in_range(
    argument: &str,
    value: f32,
    expected: &str,
    holds: impl Fn(f32) -> bool,
) -> Result<()> {
    if holds(value) {
        Ok(())
    } else {
        Err(Error::value(argument, expected, value))
    }
}

/// Converts an integer from Python to `T`; an error if it does not fit or fails `holds`.
pub fn whole<T: TryFrom<i64>>(
    argument: &str,
    value: i64,
    expected: &str,
    holds: impl Fn(&T) -> bool,
) -> Result<T> {
    let number = T::try_from(value).ok().filter(holds);
    number.ok_or_else(|| Error::value(argument, expected, value))
}
