//! numpy in, numpy out: the checks that every argument passes once, and the copies at the door.

use numpy::{
    Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::error::{Error, Kind};
use crate::image::{Image, Pixels, Size, Value, View};

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        match error.kind {
            Kind::Value => PyValueError::new_err(error.to_string()),
            Kind::Type => PyTypeError::new_err(error.to_string()),
        }
    }
}

/// The number types of image buffers.
pub trait Number: Element + Value {
    const NAME: &'static str;

    /// Converts an array of another dtype, or says why not.
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
            return Err(Error::wrong_type(name, Self::NAME, array.getattr("dtype")?).into());
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
            return Err(Error::wrong_type(name, Self::NAME, array.getattr("dtype")?).into());
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
        if !matches!(kind, "i" | "u") {
            return Err(Error::wrong_type(name, Self::NAME, array.getattr("dtype")?).into());
        }
        if array.getattr("size")?.extract::<usize>()? > 0 {
            for extreme in ["min", "max"] {
                let value: i128 = array
                    .call_method0(extreme)?
                    .call_method0("item")?
                    .extract()?;
                if u32::try_from(value).is_err() {
                    return Err(Error::value(name, Self::NAME, value).into());
                }
            }
        }
        as_contiguous(array, "uint32")
    }
}

/// An argument as a contiguous array of `T`: itself if it is one, otherwise one converted copy.
pub fn array<'py, T: Number>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    if let Ok(array) = value.cast::<PyArrayDyn<T>>()
        && array.is_c_contiguous()
        && let Ok(readonly) = array.try_readonly()
        && readonly.as_slice().is_ok()
    {
        return Ok(readonly);
    }
    let array = value
        .py()
        .import("numpy")?
        .call_method1("asarray", (value,))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let array = T::convert(&array, name, &kind)?;
    Ok(array
        .cast::<PyArrayDyn<T>>()
        .map_err(PyErr::from)?
        .try_readonly()?)
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
}

impl<'py, T: Number> Input<'py, T> {
    pub fn new(value: &Bound<'py, PyAny>, name: &str, channels: Channels) -> PyResult<Self> {
        let array = array::<T>(value, name)?;
        let shape = array.shape();
        let Some(count) = channels.count(shape) else {
            return Err(Error::value(
                name,
                format!("shape {}", channels.shapes()),
                shape_text(shape),
            )
            .into());
        };
        let size = Size {
            height: shape[0],
            width: shape[1],
        };
        if size.pixels() == 0 {
            return Err(Error::value(name, "at least 1 × 1 pixels", shape_text(shape)).into());
        }
        Ok(Self {
            size,
            channels: count,
            array,
        })
    }

    /// An argument that may be `None`, and whose size is settled by an earlier one.
    pub fn optional(
        value: Option<&Bound<'py, PyAny>>,
        name: &str,
        channels: Channels,
        size: Size,
    ) -> PyResult<Option<Self>> {
        value
            .map(|value| Self::new(value, name, channels)?.sized(name, size))
            .transpose()
    }

    pub fn sized(self, name: &str, size: Size) -> PyResult<Self> {
        if self.size == size {
            return Ok(self);
        }
        let expected = format!("height {} and width {}", size.height, size.width);
        Err(Error::value(name, expected, shape_text(self.array.shape())).into())
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

    pub fn data(&self) -> Interleaved<'_, T> {
        let data = self
            .array
            .as_slice()
            .expect("contiguity was established by `array`");
        Interleaved {
            data,
            size: self.size,
            channels: self.channels,
        }
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

/// The bare data of an image argument, to be taken apart without the interpreter.
#[derive(Clone, Copy)]
pub struct Interleaved<'a, T> {
    data: &'a [T],
    size: Size,
    channels: usize,
}

impl<'a, T: Number> Interleaved<'a, T> {
    /// The same numbers as an image of one channel, for kernels that treat all channels alike.
    pub fn flat(self) -> View<'a, T> {
        let Size { height, width } = self.size;
        View::new(
            Size {
                height,
                width: width * self.channels,
            },
            1,
            self.data,
        )
    }

    pub fn pixels(self) -> Pixels<'a, T> {
        Pixels::records(self.size, self.channels, self.data)
    }

    pub fn planes(self) -> Planes<'a, T> {
        match self.channels {
            1 => Planes::Borrowed(View::new(self.size, 1, self.data)),
            _ => Planes::Owned(Image::from_interleaved(self.size, self.channels, self.data)),
        }
    }
}

/// A planar image that is borrowed where the array already was planar.
pub enum Planes<'a, T: Value = f32> {
    Borrowed(View<'a, T>),
    Owned(Image<T>),
}

impl<T: Number> Planes<'_, T> {
    pub fn view(&self) -> View<'_, T> {
        match self {
            Self::Borrowed(view) => *view,
            Self::Owned(image) => image.view(),
        }
    }
}

/// An image on its way to numpy.
pub struct Outgoing<T: Value = f32> {
    image: Image<T>,
    shape: Vec<usize>,
}

impl<T: Element + Value> Outgoing<T> {
    /// To be (H, W) for a single channel, (H, W, C) for several.
    pub fn new(image: Image<T>) -> Self {
        let Size { height, width } = image.size;
        let channels = (image.channels > 1).then_some(image.channels);
        let shape = [height, width].into_iter().chain(channels).collect();
        Self { image, shape }
    }

    /// What was computed from [`Interleaved::flat`] images of this shape.
    pub fn flat(image: Image<T>, shape: Vec<usize>) -> Self {
        Self { image, shape }
    }

    /// Writes into the array that the caller gave, or into a new one.
    pub fn array<'py>(
        self,
        py: Python<'py>,
        out: Out<'py, T>,
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let Some(out) = out.0 else {
            let data = py.detach(|| self.image.into_interleaved());
            return data.into_pyarray(py).reshape(self.shape);
        };
        let mut array = out.try_readwrite()?;
        let slice = array.as_slice_mut()?;
        py.detach(|| self.image.view().interleave(slice));
        Ok(out)
    }
}

/// Where a result is to go, if the caller gave an array for it.
pub struct Out<'py, T: Element = f32>(Option<Bound<'py, PyArrayDyn<T>>>);

impl<'py, T: Element> Out<'py, T> {
    /// A new array.
    pub fn fresh() -> Self {
        Self(None)
    }

    /// Checks an `out=` argument before any work is done. It may be an input as well: it is written last.
    pub fn given(value: Option<Bound<'py, PyAny>>, shape: &[usize]) -> PyResult<Self> {
        let Some(value) = value else {
            return Ok(Self::fresh());
        };
        let expected = format!(
            "a writable {} array in C order of shape {}",
            T::get_dtype(value.py()),
            shape_text(shape)
        );
        let Ok(array) = value.cast::<PyArrayDyn<T>>() else {
            let got = value
                .getattr("dtype")
                .unwrap_or(value.get_type().into_any());
            return Err(Error::wrong_type("out", expected, got).into());
        };
        if array.shape() != shape {
            return Err(Error::value("out", expected, shape_text(array.shape())).into());
        }
        // Not yet borrowed: it may be an input.
        let writable: bool = value.getattr("flags")?.getattr("writeable")?.extract()?;
        if !writable || !array.is_c_contiguous() {
            return Err(Error::value("out", expected, "one that is read-only or strided").into());
        }
        Ok(Self(Some(array.clone())))
    }
}

impl<'py> Out<'py> {
    /// Has `write` fill the caller's array, or a new one of this shape, while the inputs are borrowed.
    pub fn fill(
        self,
        py: Python<'py>,
        shape: &[usize],
        write: impl FnOnce(&mut [f32]) + Send,
    ) -> PyResult<Direct<'py>> {
        let mut out = Direct::new(py, self, shape)?;
        let data = out.data()?;
        py.detach(|| write(data));
        Ok(out)
    }
}

/// Where a kernel writes a result as numpy has it, without a copy unless the memory is an input's as well.
pub struct Direct<'py, T: Element + Value = f32> {
    array: Bound<'py, PyArrayDyn<T>>,
    memory: Memory<'py, T>,
}

enum Memory<'py, T: Element> {
    Own(PyReadwriteArrayDyn<'py, T>),
    /// The array is written last.
    Shared(Vec<T>),
}

impl<'py, T: Element + Value> Direct<'py, T> {
    /// To be asked for while the inputs are borrowed.
    pub fn new(py: Python<'py>, out: Out<'py, T>, shape: &[usize]) -> PyResult<Self> {
        let array = match out.0 {
            Some(array) => array,
            // Of numpy's own memory, which comes in large pages.
            None => py
                .import("numpy")?
                .call_method1("empty", (shape.to_vec(), T::get_dtype(py)))?
                .cast_into()?,
        };
        let memory = match array.try_readwrite() {
            Ok(own) => Memory::Own(own),
            Err(_) => Memory::Shared(vec![T::default(); array.len()]),
        };
        Ok(Self { array, memory })
    }

    pub fn data(&mut self) -> PyResult<&mut [T]> {
        Ok(match &mut self.memory {
            Memory::Own(own) => own.as_slice_mut()?,
            Memory::Shared(data) => data,
        })
    }

    /// To be called when the inputs are no longer borrowed.
    pub fn array(self) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        if let Memory::Shared(data) = self.memory {
            self.array
                .try_readwrite()?
                .as_slice_mut()?
                .copy_from_slice(&data);
        }
        Ok(self.array)
    }
}

/// The parts of an `out=` argument of a function with several results.
pub fn parts<'py, const N: usize>(
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<[Option<Bound<'py, PyAny>>; N]> {
    let Some(out) = out else {
        return Ok([const { None }; N]);
    };
    let parts: Vec<Bound<'py, PyAny>> = match out.cast::<PyTuple>() {
        Ok(tuple) => tuple.iter().collect(),
        Err(_) => vec![],
    };
    let count = parts.len();
    let parts: [_; N] = parts
        .try_into()
        .map_err(|_| Error::value("out", format!("a tuple of {N}"), format!("{count} parts")))?;
    Ok(parts.map(|part| (!part.is_none()).then_some(part)))
}

/// The value of a mode's name; the error lists the names.
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

/// A small array argument of doubles, such as a matrix or a list of points.
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

/// Points of `N` coordinates, with the shape of the axes before the last.
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

/// The canonical form of a frame's buffer of this name: float32 (uint32 for `ids`), C order, and of the given height
/// and width where these are settled.
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
        "motion" => checked::<f32>(value, name, MOTION, size),
        _ => checked::<f32>(value, name, COLOR, size),
    }
}
