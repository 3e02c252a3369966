//! The one error type: which argument, what was expected, what came.

use std::fmt::{self, Display};

/// An argument out of range, of the wrong size, or missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    message: String,
}

/// A value, or the error in an argument.
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

/// `Ok` if `value` passes `holds`; `expected` describes the range in the message. Write the test as a comparison that must
/// be true, so that it refuses NaN.
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

/// An error if the value is not between 0 and 1.
pub(crate) fn from_0_to_1(argument: &str, value: f32) -> Result<()> {
    in_range(argument, value, "a fraction from 0 to 1", |v| {
        (0.0..=1.0).contains(&v)
    })
}

/// An error if the value is negative, infinite or NaN.
pub(crate) fn finite_from_0(argument: &str, value: f32) -> Result<()> {
    in_range(argument, value, "a finite number from 0", |v| {
        v >= 0.0 && v.is_finite()
    })
}

/// An error if the value is not above 0, infinite or NaN.
pub(crate) fn finite_above_0(argument: &str, value: f32) -> Result<()> {
    in_range(argument, value, "a finite number above 0", |v| {
        v > 0.0 && v.is_finite()
    })
}

/// An integer of any type, such as Python's, which may be negative or too large for the parameter.
pub(crate) trait Whole<T>: Copy + Display + TryInto<T> {}

impl<T, N: Copy + Display + TryInto<T>> Whole<T> for N {}

/// Converts an integer to `T`; an error if it does not fit or fails `holds`.
pub(crate) fn whole<T>(
    argument: &str,
    value: impl Whole<T>,
    expected: &str,
    holds: impl Fn(&T) -> bool,
) -> Result<T> {
    let number = value.try_into().ok().filter(holds);
    number.ok_or_else(|| Error::value(argument, expected, value))
}
