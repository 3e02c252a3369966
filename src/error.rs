//! The one error type: which argument, what was expected, what came.

use std::fmt::{self, Display};

/// An argument that cannot be worked with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    message: String,
}

/// A value, or what is wrong with an argument.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// `argument: expected …, got …`.
    pub(crate) fn value(argument: &str, expected: impl Display, got: impl Display) -> Self {
        Self {
            message: format!("{argument}: expected {expected}, got {got}"),
        }
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Error {}

/// `Ok` when `value` lies in the range that `holds` tests and `expected` describes; NaN never does.
pub(crate) fn in_range(
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

/// A whole number, such as Python's, which may be below zero or too large for a field.
pub(crate) trait Whole<T>: Copy + Display + TryInto<T> {}

impl<T, N: Copy + Display + TryInto<T>> Whole<T> for N {}

/// `value` when it lies in the range that `holds` tests and `expected` describes.
pub(crate) fn whole<T>(
    argument: &str,
    value: impl Whole<T>,
    expected: &str,
    holds: impl Fn(&T) -> bool,
) -> Result<T> {
    let number = value.try_into().ok().filter(holds);
    number.ok_or_else(|| Error::value(argument, expected, value))
}
