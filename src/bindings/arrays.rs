//! Conversion and validation of array arguments, and the arrays of results.

use std::cell::RefCell;
use std::fmt::Display;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use numpy::{
    Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::error::Error;
use crate::image::{Pixels, Size, Value};
use crate::memory::OutOfMemory;
use crate::rows::Settings;

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        PyValueError::new_err(error.to_string())
    }
}

/// `argument: expected …, got …` as a `TypeError`.
pub fn wrong_type(argument: &str, expected: impl Display, got: impl Display) -> PyErr {
    PyTypeError::new_err(Error::value(argument, expected, got).to_string())
}

/// `argument` was given without `other`, which it depends on.
pub fn needs(argument: &str, other: &str) -> PyErr {
    PyValueError::new_err(format!("{argument}: needs {other} as well"))
}

/// Runs `work` without the interpreter's lock; a failed allocation becomes a `MemoryError`. An error if the environment asks
/// for threads or instructions that there are not: only here, so that the command line can say so in a line of its own.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    Settings::from_environment()?;
    let done = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    done.map_err(|panic| match panic.downcast::<OutOfMemory>() {
        Ok(error) => PyMemoryError::new_err(error.to_string()),
        Err(panic) => resume_unwind(panic),
    })
}

thread_local! {
    static HELD: RefCell<Vec<(Range<usize>, Access)>> = const { RefCell::new(vec![]) };
}

#[derive(Clone, Copy, PartialEq)]
enum Access {
    Read,
    Write,
}

/// Guard: the addresses of an array that a call on this thread reads or writes. Addresses are compared because arrays
/// can share memory without a common base (`numpy.frombuffer`, `numpy.memmap`).
struct Held(Range<usize>, Access);

impl Held {
    fn new<T: Element>(array: &Bound<'_, PyArrayDyn<T>>, access: Access) -> Self {
        let start = array.data().addr();
        let range = start..start + array.len() * size_of::<T>();
        HELD.with_borrow_mut(|all| all.push((range.clone(), access)));
        Self(range, access)
    }

    /// True if another array with this kind of use overlaps these addresses.
    fn overlaps(&self, access: Access) -> bool {
        let own = (self.0.clone(), self.1);
        let mut itself = true;
        HELD.with_borrow(|all| {
            all.iter().any(|other| {
                if *other == own && std::mem::take(&mut itself) {
                    return false;
                }
                let (range, used) = other;
                *used == access && range.start < self.0.end && self.0.start < range.end
            })
        })
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        HELD.with_borrow_mut(|all| {
            let own = all
                .iter()
                .rposition(|(range, access)| (range, access) == (&self.0, &self.1));
            all.swap_remove(own.expect("was added"));
        });
    }
}

/// Element types of image buffers.
pub trait Number: Element + Value {
    const NAME: &'static str;

    /// Converts an array of another dtype, or explains why it cannot.
    fn convert<'py>(
        array: &Bound<'py, PyAny>,
        name: &str,
        kind: &str,
    ) -> PyResult<Bound<'py, PyAny>>;
}

fn as_contiguous<'py>(array: &Bound<'py, PyAny>, dtype: &str) -> PyResult<Bound<'py, PyAny>> {
    let options = PyDict::new(array.py());
    options.set_item("dtype", dtype)?;
    options.set_item("requirements", "CA")?;
    // Unlike `ascontiguousarray`, `require` keeps a 0-d array 0-d, so that errors show the caller's own shape.
    array
        .py()
        .import("numpy")?
        .call_method("require", (array,), Some(&options))
}

impl Number for f32 {
    const NAME: &'static str = "floats (float16, float32 or float64)";

    fn convert<'py>(
        array: &Bound<'py, PyAny>,
        name: &str,
        kind: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        if kind != "f" {
            let dtype = array.getattr("dtype")?.to_string();
            let encoded = |most| {
                format!(
                    ": colours of whole numbers are gamma-encoded; (x / {most}) ** 2.2 is linear"
                )
            };
            let advice = match &*dtype {
                "uint8" => encoded(255),
                "uint16" => encoded(65535),
                "bfloat16" => ": pass x.astype(numpy.float32)".into(),
                _ => String::new(),
            };
            return Err(wrong_type(name, Self::NAME, dtype + &advice));
        }
        as_contiguous(array, "float32")
    }
}

impl Number for f64 {
    const NAME: &'static str = "numbers";

    fn convert<'py>(
        array: &Bound<'py, PyAny>,
        name: &str,
        kind: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        if !matches!(kind, "f" | "i" | "u") {
            return Err(wrong_type(name, Self::NAME, array.getattr("dtype")?));
        }
        as_contiguous(array, "float64")
    }
}

impl Number for u32 {
    const NAME: &'static str = "whole numbers (any integer type, values of 0 to 2³² − 1)";

    fn convert<'py>(
        array: &Bound<'py, PyAny>,
        name: &str,
        kind: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        convert_whole::<Self>(array, name, kind, "uint32")
    }
}

impl Number for u8 {
    const NAME: &'static str = "whole numbers (any integer type, values of 0 to 255)";

    fn convert<'py>(
        array: &Bound<'py, PyAny>,
        name: &str,
        kind: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        convert_whole::<Self>(array, name, kind, "uint8")
    }
}

/// Converts an array of whole numbers, none of which may be out of the type's range.
fn convert_whole<'py, T: Number + TryFrom<i128>>(
    array: &Bound<'py, PyAny>,
    name: &str,
    kind: &str,
    dtype: &str,
) -> PyResult<Bound<'py, PyAny>> {
    if !matches!(kind, "i" | "u") {
        return Err(wrong_type(name, T::NAME, array.getattr("dtype")?));
    }
    if array.getattr("size")?.extract::<usize>()? > 0 {
        for extreme in ["min", "max"] {
            let value: i128 = array
                .call_method0(extreme)?
                .call_method0("item")?
                .extract()?;
            if T::try_from(value).is_err() {
                return Err(Error::value(name, T::NAME, value).into());
            }
        }
    }
    as_contiguous(array, dtype)
}

/// An argument as a contiguous array of `T`: itself if it is one, otherwise one converted copy.
pub fn array<'py, T: Number>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    refuse_mask(value, name)?;
    if let Ok(array) = value.cast::<PyArrayDyn<T>>()
        && array.is_c_contiguous()
        && let Ok(readonly) = array.try_readonly()
        && readonly.as_slice().is_ok()
    {
        return Ok(readonly);
    }
    if value.is_none() {
        return Err(wrong_type(name, T::NAME, "None"));
    }
    refuse_gradients(value, name)?;
    let array = value
        .py()
        .import("numpy")?
        .call_method1("asarray", (value,))
        .map_err(|error| unreadable(value, name, error))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let array = T::convert(&array, name, &kind)?;
    Ok(array
        .cast::<PyArrayDyn<T>>()
        .map_err(PyErr::from)?
        .try_readonly()?)
}

/// An error if a masked array is given: its data would be taken for valid everywhere.
pub fn refuse_mask(value: &Bound<'_, PyAny>, name: &str) -> PyResult<()> {
    if value.is_exact_instance_of::<PyUntypedArray>() {
        return Ok(());
    }
    let masked = value.py().import("numpy.ma")?.getattr("MaskedArray")?;
    match value.is_instance(&masked)? {
        true => Err(wrong_type(
            name,
            "an array without a mask",
            "a masked one: x.filled(nan) marks what is missing",
        )),
        false => Ok(()),
    }
}

/// An error if gradients would be lost: Dr.Jit converts tensors that have any without a word, where torch refuses.
fn refuse_gradients(value: &Bound<'_, PyAny>, name: &str) -> PyResult<()> {
    let py = value.py();
    let module = value.get_type().module()?;
    if !module.to_cow()?.starts_with("drjit") {
        return Ok(());
    }
    let drjit = py.import("drjit")?;
    match drjit.call_method1("grad_enabled", (value,))?.is_truthy()? {
        true => Err(wrong_type(
            name,
            "an array",
            "a tensor that needs gradients: pass drjit.detach(x)",
        )),
        false => Ok(()),
    }
}

/// The error for an argument that numpy cannot read: tensors on another device, or of a type that numpy lacks.
fn unreadable(value: &Bound<'_, PyAny>, name: &str, error: PyErr) -> PyErr {
    let text = |attribute| {
        value
            .getattr(attribute)
            .map_or(String::new(), |v| v.to_string())
    };
    let got = if text("requires_grad") == "True" {
        "a tensor that needs gradients: pass x.detach()"
    } else if text("dtype").ends_with("bfloat16") {
        "bfloat16, which numpy does not have: pass x.float()"
    } else if text("is_cuda") == "True" {
        "a tensor on a GPU: pass x.cpu()"
    } else if error.is_instance_of::<PyValueError>(value.py()) {
        // Such as lists of rows of different length.
        return PyValueError::new_err(format!("{name}: {}", error.value(value.py())));
    } else if error.is_instance_of::<PyTypeError>(value.py())
        || error.is_instance_of::<PyRuntimeError>(value.py())
    {
        let kind = (value.get_type().name()).map_or(String::new(), |name| name.to_string());
        &format!(
            "{kind}, which numpy cannot read: {}",
            error.value(value.py())
        )
    } else {
        return error;
    };
    wrong_type(name, "an array", got)
}

/// The shapes that a buffer may have.
#[derive(Clone, Copy)]
pub enum Channels {
    /// (H, W).
    One,
    /// (H, W, C) for these C.
    Of(&'static [usize]),
    /// (H, W) or (H, W, 3).
    OneOr3,
    /// (H, W) or (H, W, C) for any C.
    Any,
}

impl Channels {
    fn count(self, shape: &[usize]) -> Option<usize> {
        match (self, shape) {
            (Self::One | Self::OneOr3 | Self::Any, [_, _]) => Some(1),
            (Self::OneOr3, [_, _, 3]) => Some(3),
            (Self::Of(counts), [_, _, c]) if counts.contains(c) => Some(*c),
            (Self::Any, [_, _, c]) if *c > 0 => Some(*c),
            _ => None,
        }
    }

    /// Advice for an unsupported shape, part of the error message.
    fn advice(self, shape: &[usize]) -> &'static str {
        let fits = |shape: &[usize]| self.count(shape).is_some();
        match *shape {
            [c, h, w] if fits(&[h, w, c]) => ": channels come last; pass numpy.moveaxis(x, 0, -1)",
            [4, h, w] if fits(&[h, w, 3]) => {
                ": channels come last, without alpha; pass numpy.moveaxis(x[:3], 0, -1)"
            }
            [h, w, 4] if fits(&[h, w, 2]) => {
                ": pass two channels, to the previous frame: x[..., :2]"
            }
            [h, w, 4] if fits(&[h, w, 3]) => ": pass three channels, without alpha: x[..., :3]",
            [h, w, 1] if fits(&[h, w]) => ": pass x[..., 0]",
            [1, h, w] if fits(&[h, w]) => ": pass x[0]",
            _ => "",
        }
    }

    fn shapes(self) -> String {
        match self {
            Self::One => "(H, W)".into(),
            Self::Of(counts) => counts
                .iter()
                .map(|c| format!("(H, W, {c})"))
                .collect::<Vec<_>>()
                .join(" or "),
            Self::OneOr3 => "(H, W) or (H, W, 3)".into(),
            Self::Any => "(H, W) or (H, W, C)".into(),
        }
    }
}

/// A checked image argument.
pub struct Input<'py, T: Number = f32> {
    array: PyReadonlyArrayDyn<'py, T>,
    size: Size,
    channels: usize,
    _held: Held,
}

impl<'py, T: Number> Input<'py, T> {
    pub fn new(value: &Bound<'py, PyAny>, name: &str, channels: Channels) -> PyResult<Self> {
        let array = array::<T>(value, name)?;
        let shape = array.shape();
        let Some(count) = channels.count(shape) else {
            return Err(Error::value(
                name,
                format!("shape {}", channels.shapes()),
                shape_text(shape) + channels.advice(shape),
            )
            .into());
        };
        let size = Size {
            height: shape[0],
            width: shape[1],
        };
        size.check(name)?;
        Ok(Self {
            size,
            channels: count,
            _held: Held::new(&array, Access::Read),
            array,
        })
    }

    /// An argument that must have the size of an earlier one.
    pub fn of_size(
        value: &Bound<'py, PyAny>,
        name: &str,
        channels: Channels,
        size: Size,
    ) -> PyResult<Self> {
        Self::new(value, name, channels)?.sized(name, size)
    }

    /// The same for an optional argument.
    pub fn optional(
        value: Option<&Bound<'py, PyAny>>,
        name: &str,
        channels: Channels,
        size: Size,
    ) -> PyResult<Option<Self>> {
        value
            .map(|value| Self::of_size(value, name, channels, size))
            .transpose()
    }

    pub fn sized(self, name: &str, size: Size) -> PyResult<Self> {
        if self.size == size {
            return Ok(self);
        }
        let advice = match *self.array.shape() {
            [_, h, w] if (h, w) == (size.height, size.width) => {
                ": channels come last; pass numpy.moveaxis(x, 0, -1)"
            }
            _ => "",
        };
        Err(Error::value(name, size, shape_text(self.array.shape()) + advice).into())
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    pub fn channels(&self) -> usize {
        self.channels
    }

    pub fn pixels(&self) -> Pixels<'_, T> {
        let data = self.array.as_slice();
        let data = data.expect("contiguity was established by `array`");
        Pixels::of_interleaved(self.size, self.channels, data)
    }

    pub fn array(self) -> Bound<'py, PyArrayDyn<T>> {
        (*self.array).clone()
    }
}

fn shape_text(shape: &[usize]) -> String {
    let sides: Vec<_> = shape.iter().map(ToString::to_string).collect();
    format!(
        "({}{})",
        sides.join(", "),
        if sides.len() == 1 { "," } else { "" }
    )
}

/// The caller's `out` array, or a new one of its shape.
pub struct Out<'py, T: Element = f32> {
    array: Option<Bound<'py, PyArrayDyn<T>>>,
    shape: Vec<usize>,
}

impl<'py, T: Element> Out<'py, T> {
    /// A new array.
    pub fn fresh(shape: &[usize]) -> Self {
        Self {
            array: None,
            shape: shape.to_vec(),
        }
    }

    /// Checks an `out` argument before any work is done. It may alias an input, because it is written last.
    pub fn given(value: Option<Bound<'py, PyAny>>, shape: &[usize]) -> PyResult<Self> {
        let Some(value) = value else {
            return Ok(Self::fresh(shape));
        };
        refuse_mask(&value, "out")?;
        let expected = format!(
            "a writable {} array in C order of shape {}",
            T::get_dtype(value.py()),
            shape_text(shape)
        );
        let Ok(array) = value.cast::<PyArrayDyn<T>>() else {
            let got = value
                .getattr("dtype")
                .unwrap_or(value.get_type().into_any());
            return Err(wrong_type("out", expected, got));
        };
        if array.shape() != shape {
            return Err(Error::value("out", expected, shape_text(array.shape())).into());
        }
        // Not borrowed yet, because it may alias an input.
        let writable: bool = value.getattr("flags")?.getattr("writeable")?.extract()?;
        if !writable || !array.is_c_contiguous() {
            return Err(Error::value("out", expected, "one that is read-only or strided").into());
        }
        Ok(Self {
            array: Some(array.clone()),
            shape: shape.to_vec(),
        })
    }
}

impl<'py> Out<'py, bool> {
    /// The bytes that booleans consist of: kernels write 0 and 1.
    pub fn bytes(&self) -> PyResult<Out<'py, u8>> {
        let view = |array: &Bound<'py, PyArrayDyn<bool>>| -> PyResult<_> {
            Ok(array.call_method1("view", ("uint8",))?.cast_into()?)
        };
        Ok(Out {
            array: self.array.as_ref().map(view).transpose()?,
            shape: self.shape.clone(),
        })
    }

    /// The caller's array, or these bytes as a new one.
    pub fn array(
        self,
        bytes: Bound<'py, PyArrayDyn<u8>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
        let fresh = || Ok(bytes.call_method1("view", ("bool",))?.cast_into()?);
        self.array.map_or_else(fresh, Ok)
    }
}

impl<'py, T: Element + Value> Out<'py, T> {
    /// Lets `write` fill the array while the inputs are borrowed.
    pub fn fill(
        self,
        py: Python<'py>,
        write: impl FnOnce(&mut [T]) + Send,
    ) -> PyResult<Direct<'py, T>> {
        let mut out = Direct::new(py, self)?;
        let data = out.data()?;
        detached(py, || write(data))?;
        Ok(out)
    }
}

/// The array that a kernel writes in place; a temporary one, copied at the end, if `out` overlaps an input.
pub struct Direct<'py, T: Element + Value = f32> {
    array: Bound<'py, PyArrayDyn<T>>,
    /// The memory that the kernel writes: the array's own, or the temporary's.
    written: PyReadwriteArrayDyn<'py, T>,
    last: bool,
    _held: Held,
}

impl<'py, T: Element + Value> Direct<'py, T> {
    /// Must be called while the inputs and the arrays of earlier results are borrowed.
    pub fn new(py: Python<'py>, Out { array, shape }: Out<'py, T>) -> PyResult<Self> {
        // Allocated by numpy, which uses large pages.
        let empty = || -> PyResult<Bound<'py, PyArrayDyn<T>>> {
            let empty =
                (py.import("numpy")?).call_method1("empty", (shape.clone(), T::get_dtype(py)))?;
            Ok(empty.cast_into()?)
        };
        let array = array.map_or_else(empty, Ok)?;
        let held = Held::new(&array, Access::Write);
        if held.overlaps(Access::Write) {
            let expected = "arrays that share no memory with each other";
            return Err(Error::value("out", expected, "two that do").into());
        }
        let own = array.try_readwrite().ok();
        let (written, last) = match own.filter(|_| !held.overlaps(Access::Read)) {
            Some(own) => (own, false),
            None => (empty()?.try_readwrite()?, true),
        };
        Ok(Self {
            array,
            written,
            last,
            _held: held,
        })
    }

    pub fn data(&mut self) -> PyResult<&mut [T]> {
        Ok(self.written.as_slice_mut()?)
    }

    /// Must be called after the inputs have been released.
    pub fn array(self) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        if self.last {
            let mut array = self.array.try_readwrite()?;
            array
                .as_slice_mut()?
                .copy_from_slice(self.written.as_slice()?);
        }
        Ok(self.array)
    }
}

/// The elements of an `out` argument of a function with several results.
pub fn parts<'py, const N: usize>(
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<[Option<Bound<'py, PyAny>>; N]> {
    let Some(out) = out else {
        return Ok([const { None }; N]);
    };
    let wrong = |got: String| Error::value("out", format!("a tuple of {N}"), got);
    let Ok(tuple) = out.cast::<PyTuple>() else {
        return Err(wrong(out.get_type().name()?.to_string()).into());
    };
    let parts: Vec<_> = tuple.iter().collect();
    let parts: [_; N] = parts
        .try_into()
        .map_err(|parts: Vec<_>| wrong(format!("{} parts", parts.len())))?;
    Ok(parts.map(|part| (!part.is_none()).then_some(part)))
}

/// Lets `write` fill the arrays of a function with several results, those of the caller's `out` tuple or new ones, while the
/// inputs are borrowed.
pub fn fill_parts<'py, const N: usize>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    shapes: [&[usize]; N],
    write: impl FnOnce([&mut [f32]; N]) + Send,
) -> PyResult<[Direct<'py>; N]> {
    let given = parts::<N>(out)?.into_iter().zip(shapes);
    // Check all of them before writing any.
    let given: Vec<_> = given
        .map(|(part, shape)| Out::given(part, shape))
        .collect::<PyResult<_>>()?;
    let mut results: Vec<_> = given
        .into_iter()
        .map(|out| Direct::new(py, out))
        .collect::<PyResult<_>>()?;
    let data: Vec<_> = (results.iter_mut())
        .map(Direct::data)
        .collect::<PyResult<_>>()?;
    let data = data.try_into().expect("as many as shapes");
    detached(py, || write(data))?;
    Ok(results.try_into().ok().expect("as many as shapes"))
}

/// Parses the name of a mode; the error lists the valid names.
pub fn choice<T: Copy>(argument: &str, name: &str, names: &[(&str, T)]) -> PyResult<T> {
    let found = names.iter().find(|(known, _)| *known == name);
    let Some(&(_, value)) = found else {
        let known: Vec<_> = names
            .iter()
            .map(|(known, _)| format!("{known:?}"))
            .collect();
        let expected = format!("one of {}", known.join(", "));
        return Err(Error::value(argument, expected, format!("{name:?}")).into());
    };
    Ok(value)
}

/// A small float64 array argument, such as a matrix or a list of points.
pub fn doubles<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    array::<f64>(value, name)
}

pub fn matrix4(value: &Bound<'_, PyAny>, name: &str) -> PyResult<[[f64; 4]; 4]> {
    let array = doubles(value, name)?;
    if array.shape() != [4, 4] {
        return Err(Error::value(name, "shape (4, 4)", shape_text(array.shape())).into());
    }
    let data = array.as_slice()?;
    Ok(std::array::from_fn(|i| {
        std::array::from_fn(|j| data[4 * i + j])
    }))
}

pub fn vector<const N: usize>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<[f64; N]> {
    let array = doubles(value, name)?;
    if array.shape() != [N] {
        return Err(Error::value(name, format!("shape ({N},)"), shape_text(array.shape())).into());
    }
    Ok(std::array::from_fn(|i| {
        array.as_slice().expect("contiguous")[i]
    }))
}

/// Points of `N` coordinates, and the shape of the leading axes.
pub fn points<const N: usize>(
    value: &Bound<'_, PyAny>,
    name: &str,
) -> PyResult<(Vec<[f64; N]>, Vec<usize>)> {
    let array = doubles(value, name)?;
    match array.shape() {
        [outer @ .., last] if *last == N => Ok((
            array.as_slice()?.as_chunks::<N>().0.to_vec(),
            outer.to_vec(),
        )),
        shape => Err(Error::value(name, format!("shape (…, {N})"), shape_text(shape)).into()),
    }
}

pub const COLOR: Channels = Channels::Of(&[3]);
pub const MOTION: Channels = Channels::Of(&[2, 3]);

/// Convert a frame's buffer to its canonical form: float32 (uint32 for `ids`) in C order.
///
/// Parameters
/// ----------
/// value : array_like
///     The buffer.
/// name : str
///     Its name in `Frame`, which determines channels and element type.
/// size : (int, int), optional
///     Height and width that it must have.
///
/// Returns
/// -------
/// (H, W) or (H, W, C) ndarray
///     The buffer itself if it is canonical, else a copy.
///
/// Raises
/// ------
/// TypeError, ValueError
///     On a wrong element type, shape or size.
#[pyfunction]
#[pyo3(signature = (value, name, size=None))]
pub fn canonical<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
    size: Option<(usize, usize)>,
) -> PyResult<Bound<'py, PyAny>> {
    fn checked<'py, T: Number>(
        value: &Bound<'py, PyAny>,
        name: &str,
        channels: Channels,
        size: Option<(usize, usize)>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let input = Input::<T>::new(value, name, channels)?;
        let input = match size {
            Some((height, width)) => input.sized(name, Size { height, width })?,
            None => input,
        };
        Ok(input.array().into_any())
    }
    match name {
        "ids" => checked::<u32>(value, name, Channels::One, size),
        "depth" | "hit_distance" | "reactive" => checked::<f32>(value, name, Channels::One, size),
        "motion" | "motion_next" => checked::<f32>(value, name, MOTION, size),
        _ => checked::<f32>(value, name, COLOR, size),
    }
}
