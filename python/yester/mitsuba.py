"""Denoising in scripts for Mitsuba 3, with the calls of its `OptixDenoiser`, which needs an NVIDIA GPU."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ._core import SVGF, Output
from .frame import Frame
from .tensors import as_array

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Denoiser"]


class _Steps(Protocol):
    def step(self, frame: Frame, /) -> Output: ...

    def reset(self) -> None: ...


class Denoiser:
    """A denoiser that is called as Mitsuba's `OptixDenoiser` is, on any CPU.

    Parameters
    ----------
    input_size : (int, int)
        Width and height of the images.
    albedo, normals : bool, default False
        Whether albedo and normals will be given.
    temporal : bool, default False
        Whether history is used. Otherwise each image is denoised by itself.
    denoise_alpha : bool, default False
        Whether a fourth channel is denoised as well; otherwise it is passed on.
    pipeline : Pipeline, optional
        What denoises; by default ``SVGF()``. A copy of it works. For single images, `OIDN` is better if it is
        installed.

    Raises
    ------
    ValueError
        If the size is not positive.

    Notes
    -----
    What differs from `OptixDenoiser`: history is kept here, not in `previous_denoised`, which only tells whether the
    sequence goes on; and normals may be in any space that does not move with the camera, so that `to_sensor` is not
    needed. Frames with depth and cameras are denoised better by the pipelines themselves, as `render_sequence` of
    `yester.io.mitsuba` makes them.

    Examples
    --------
    >>> import numpy as np
    >>> denoiser = Denoiser((32, 24), albedo=True, temporal=True)
    >>> noisy, albedo, flow = np.ones((24, 32, 3)), np.ones((24, 32, 3)), np.zeros((24, 32, 2))
    >>> first = denoiser(noisy, albedo, flow=flow, previous_denoised=noisy)
    >>> second = denoiser(noisy, albedo, flow=flow, previous_denoised=first)
    >>> second.shape
    (24, 32, 3)
    """

    def __init__(
        self,
        input_size: Sequence[int],
        albedo: bool = False,
        normals: bool = False,
        temporal: bool = False,
        denoise_alpha: bool = False,
        *,
        pipeline: _Steps | None = None,
    ) -> None:
        width, height = (int(side) for side in input_size)
        if min(width, height) < 1:
            raise ValueError(f"input_size: expected at least 1 x 1, got {width} x {height}")
        self._shape = height, width
        self._needs = {"albedo": albedo, "normals": normals, "flow": temporal, "previous_denoised": temporal}
        self._temporal, self._denoise_alpha = temporal, denoise_alpha
        self._color: _Steps = SVGF() if pipeline is None else copy.copy(pipeline)
        self._alpha: _Steps = copy.copy(self._color)
        self._last: NDArray[Any] | None = None

    def __call__(
        self,
        noisy: Any,
        albedo: Any = None,
        normals: Any = None,
        to_sensor: object = None,
        flow: Any = None,
        previous_denoised: Any = None,
        *,
        albedo_ch: str = "",
        normals_ch: str = "",
        flow_ch: str = "",
        previous_denoised_ch: str = "",
        noisy_ch: str = "<root>",
    ) -> Any:
        """Denoise an image.

        Parameters
        ----------
        noisy : TensorXf, Bitmap or array_like
            (H, W, 3) or, with alpha, (H, W, 4): linear. Or a bitmap of many channels, with the names of its layers in
            `noisy_ch`, `albedo_ch`, `normals_ch`, `flow_ch` and `previous_denoised_ch`, which may take the place of
            the tensors.
        albedo, normals : (H, W, 3) TensorXf or array_like, optional
            Given if, and only if, the denoiser was made for them.
        to_sensor : optional
            Not used: see the notes of the class.
        flow : (H, W, 2) TensorXf or array_like, optional
            With `temporal`: the motion of each pixel from the previous frame to this one, in pixels, x right, y down.
            It is the negative of `Frame.motion`.
        previous_denoised : (H, W, 3) or (H, W, 4) TensorXf or array_like, optional
            With `temporal`: the previous call's result, by which the sequence goes on. Anything else, such as `noisy`
            itself for the first frame, begins a new one.

        Returns
        -------
        TensorXf, Bitmap or ndarray
            As `noisy`.

        Raises
        ------
        ValueError
            If an image has another size, or is missing, or was not expected.
        TypeError
            If a tensor has gradients enabled, which denoising would lose.
        """
        given = {"albedo": albedo, "normals": normals, "flow": flow, "previous_denoised": previous_denoised}
        names = {"albedo": albedo_ch, "normals": normals_ch, "flow": flow_ch, "previous_denoised": previous_denoised_ch}
        bitmap = type(noisy).__name__ == "Bitmap"
        if bitmap:
            layers = {name: np.array(layer) for name, layer in noisy.split()}
            for name, value in given.items():
                layer = value if isinstance(value, str) else names[name]
                given[name] = _layer(name, layer, layers) if layer else value
            # A bitmap of few channels has no layers.
            image = _layer("noisy", noisy_ch, layers) if layers else np.array(noisy)
        else:
            image = as_array(noisy, "noisy")
        for name, value in given.items():
            if self._needs[name] and value is None:
                raise ValueError(f"{name}: expected one, as the denoiser was made for it, got none")
            if not self._needs[name] and value is not None:
                option = "temporal" if name in ("flow", "previous_denoised") else name
                raise ValueError(f"{name}: expected none from a denoiser that was made without {option}=True, got one")
        if image.ndim != 3 or image.shape[:2] != self._shape or image.shape[2] not in (3, 4):
            expected = f"shape {(*self._shape, 3)} or {(*self._shape, 4)}"
            raise ValueError(f"noisy: expected {expected}, got {image.shape}")
        arrays = {name: None if value is None else as_array(value, name) for name, value in given.items()}
        previous = arrays["previous_denoised"]
        if not (self._temporal and self._last is not None and previous is not None and _same(previous, self._last)):
            self._color.reset()
            self._alpha.reset()
        buffers: dict[str, Any] = {"albedo": arrays["albedo"], "normal": arrays["normals"]}
        if arrays["flow"] is not None:
            buffers["motion"] = -arrays["flow"]
        result = self._color.step(Frame(np.ascontiguousarray(image[..., :3]), **buffers)).color
        if image.shape[2] == 4:
            alpha = image[..., 3]
            if self._denoise_alpha:
                without = {name: value for name, value in buffers.items() if name != "albedo"}
                alpha = self._alpha.step(Frame(np.repeat(alpha[..., None], 3, 2), **without)).color[..., 0].clip(0, 1)
            result = np.concatenate([result, alpha[..., None]], 2, dtype=np.float32)
        self._last = np.array(result)
        return result if isinstance(noisy, np.ndarray | list | tuple) else type(noisy)(result)


def _layer(what: str, name: str, layers: dict[str, NDArray[Any]]) -> NDArray[Any]:
    if name not in layers:
        raise ValueError(f"{what}: expected one of the layers {', '.join(layers) or 'of a bitmap'}, got {name}")
    return layers[name]


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=True)
