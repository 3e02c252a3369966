"""Images with channels first, and batches of them, as neural networks have them; and back.

Functions of Yester take CPU tensors of torch, Mitsuba and other libraries as they are: those with float32 values in
(H, W, C) order share their memory. `Frame` and the functions here also take objects that have DLPack alone, without
``__array__``; for other functions, ``numpy.from_dlpack`` makes an array of such an object. Results are numpy arrays,
which ``torch.from_dlpack`` (or any other library's) takes without a copy.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["channels_first", "channels_last"]


def channels_last(images: ArrayLike, *, copy: bool | None = None) -> NDArray[Any]:
    """Move channels behind the columns: (C, H, W) to (H, W, C), and batches likewise.

    Parameters
    ----------
    images : (..., C, H, W) array_like
        A numpy array, a CPU tensor of any library with DLPack, or a nested sequence; any leading axes, such as those of
        a batch and of time.
    copy : bool, optional
        True: a copy in C order. False: a view, never a copy. By default a view if it is in C order, as it is for
        tensors in torch's memory format ``channels_last``, and a copy otherwise, which every function of Yester would
        make of a view.

    Returns
    -------
    ndarray
        (..., H, W, C), of the same type; (..., H, W) if C is 1, as depths and ids are.

    Raises
    ------
    TypeError
        If it has a mask, or is a tensor that needs gradients, is on another device, or of a type that numpy lacks.
    ValueError
        If there are fewer than three axes; if `copy` is False and a view cannot be made.

    Examples
    --------
    >>> import numpy as np
    >>> channels_last(np.zeros((8, 3, 24, 32))).shape
    (8, 24, 32, 3)
    >>> channels_last(np.zeros((1, 24, 32))).shape
    (24, 32)
    """
    array = _array(images, copy)
    if array.ndim < 3:
        raise ValueError(f"images: expected shape (..., C, H, W), got {array.shape}")
    moved = array[..., 0, :, :] if array.shape[-3] == 1 else np.moveaxis(array, -3, -1)
    return _ordered(moved, copy)


def channels_first(images: ArrayLike, *, channels: bool = True, copy: bool | None = None) -> NDArray[Any]:
    """Move channels before the rows: (H, W, C) to (C, H, W), and batches likewise.

    Parameters
    ----------
    images : (..., H, W, C) or (..., H, W) array_like
        Results of Yester, one or several.
    channels : bool, default True
        Whether the last axis is that of channels. If not, an axis of one channel is added.
    copy : bool, optional
        True: a copy in C order, which networks work on fastest. False: a view, never a copy. By default a view, of
        nested sequences a copy.

    Returns
    -------
    ndarray
        (..., C, H, W), of the same type; ``torch.from_dlpack`` makes a tensor of it without a copy.

    Raises
    ------
    TypeError, ValueError
        As for `channels_last`.

    Examples
    --------
    >>> import numpy as np
    >>> channels_first(np.zeros((8, 24, 32, 3))).shape
    (8, 3, 24, 32)
    >>> channels_first(np.zeros((24, 32)), channels=False).shape
    (1, 24, 32)
    """
    array = _array(images, copy)
    least = 3 if channels else 2
    if array.ndim < least:
        expected = "(..., H, W, C)" if channels else "(..., H, W)"
        raise ValueError(f"images: expected shape {expected}, got {array.shape}")
    moved = np.moveaxis(array, -1, -3) if channels else array[..., None, :, :]
    return _ordered(moved, bool(copy))


def _ordered(array: NDArray[Any], copy: bool | None) -> NDArray[Any]:
    if copy is None:
        return np.ascontiguousarray(array)
    return np.array(array, order="C") if copy else array


def shared(value: Any, name: str) -> Any:
    """An array in the memory of a tensor, that is, of an object that has DLPack; any other value as it is.

    TypeError if a mask would be lost, or gradients: Dr.Jit converts tensors that have any without a word, where torch
    refuses.
    """
    if np.ma.isMaskedArray(value):
        got = "a masked one: x.filled(nan) marks what is missing"
        raise TypeError(f"{name}: expected an array without a mask, got {got}")
    if type(value).__module__.startswith("drjit") and import_module("drjit").grad_enabled(value):
        raise TypeError(f"{name}: expected an array, got a tensor that needs gradients: pass drjit.detach(x)")
    if isinstance(value, np.ndarray) or not hasattr(value, "__dlpack__"):
        return value
    return _read(np.asarray if hasattr(value, "__array__") else np.from_dlpack, value, name)


def _array(images: Any, copy: bool | None) -> NDArray[Any]:
    """An array that shares its memory with what is given, if that is possible."""
    if copy is False and isinstance(images, list | tuple):
        raise ValueError(f"copy: expected True or None for a nested sequence, got {copy}")
    return as_array(images, "images")


def as_array(value: Any, name: str) -> NDArray[Any]:
    """An array of any type; TypeError, with what to do, of a tensor that numpy cannot read."""
    return _read(np.asarray, shared(value, name), name)


def _read(read: Callable[[Any], NDArray[Any]], value: Any, name: str) -> NDArray[Any]:
    try:
        return read(value)
    except (BufferError, RuntimeError, TypeError) as error:
        named = {key: str(getattr(value, key, "")) for key in ("requires_grad", "device", "dtype")}
        if named["requires_grad"] == "True":
            got = "a tensor that needs gradients: pass x.detach()"
        elif named["dtype"].endswith("bfloat16"):
            got = "bfloat16, which numpy does not have: pass x.float()"
        elif named["device"] not in ("", "cpu"):
            got = f"a tensor on {named['device']}: pass x.cpu()"
        else:
            got = f"{type(value).__name__}, which numpy cannot read: {error}"
        raise TypeError(f"{name}: expected an array, got {got}") from error
