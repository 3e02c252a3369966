"""Open Image Denoise, a neural network, as a pipeline."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ._core import SVGF, TAA, Output, Pipeline, exposure, innovation, settings
from .frame import Frame, present

__all__ = ["OIDN", "Network"]


class OIDN(Pipeline):
    """Intel's Open Image Denoise, with albedo and normals where frames have them; alone, or between temporal stages.

    The network processes single images, so that its errors flicker. With `temporal`, its input is the colour
    accumulated by `SVGF`, and `TAA` with preset "denoised" follows.

    Parameters
    ----------
    quality : {"high", "balanced", "fast"}, default "high"
        Quality of the network, from slow to fast.
    temporal : bool, default False
        Accumulate before the network and antialias after it.
    fireflies : bool, default False
        With `temporal`, as in `SVGF`.
    innovation : bool, default True
        With `temporal`, add the error of the network's image, as estimated from new samples, to it.

    Raises
    ------
    ImportError
        If the package mitsuba-oidn is not installed or cannot be loaded.
    ValueError
        If the quality is unknown; if `fireflies` is set without `temporal`.

    See Also
    --------
    SVGF : Denoises without a network.

    Notes
    -----
    The network is the filter "RT" of Intel's Open Image Denoise [1]_. `temporal` consists of
    ``SVGF(alpha=0.05, iterations=0, choice=False, innovation=False, antialias=False)``, the network, `innovation` (with
    the `exposure` of the network's image, and ``fed_back=False``) and ``TAA("denoised", innovation=True)`` with the
    frame's samples and the `confidence` of SVGF's output, both with its `motion`, and gives their bits. Tried and found
    worse: demodulated input, for the network or for innovation; feeding innovation back into the accumulated history; a
    second accumulation of the network's output. As many threads run as ``YESTER_THREADS`` allows.

    References
    ----------
    .. [1] A. T. Áfra, Intel, "Open Image Denoise", www.openimagedenoise.org, 2019 to date.

    Examples
    --------
    >>> frame = yester.Frame(np.random.default_rng(0).gamma(1, 0.5, (32, 32, 3)))
    >>> output = yester.OIDN("fast").step(frame)
    >>> bool(output.color.std() < frame.color.std() / 2)
    True
    """

    def __init__(
        self,
        quality: Literal["high", "balanced", "fast"] = "high",
        *,
        temporal: bool = False,
        fireflies: bool = False,
        innovation: bool = True,
    ) -> None:
        super().__init__(quality, temporal=temporal, fireflies=fireflies, innovation=innovation)
        self._network = Network(quality)
        if fireflies and not temporal:
            raise ValueError("fireflies: expected False without temporal, as the network itself removes them, got True")
        history = SVGF(alpha=0.05, iterations=0, choice=False, innovation=False, antialias=False, fireflies=fireflies)
        self._stages = (history, TAA("denoised", innovation=innovation)) if temporal else None
        self._corrects = innovation
        self._forget()

    def step(self, frame: Frame, out: Output | None = None) -> Output:
        """Denoise the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame; with `temporal`, of the same size as the previous ones.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones.

        Returns
        -------
        Output
            Without a variance. Without `temporal`, `history_length` is 1, or 0 for missing pixels.

        Raises
        ------
        TypeError
            If `frame` is no `Frame`, or `out` no `Output`.
        ValueError
            With `temporal`, if the size changes, or albedo appears or vanishes, without `reset` in between; if `out`
            does not fit.
        """
        if not isinstance(frame, Frame):
            raise TypeError(f"frame: expected a yester.Frame, got {type(frame).__name__}")
        if out is not None and not isinstance(out, Output):
            raise TypeError(f"out: expected a yester.Output, got {type(out).__name__}")
        if out is not None and (out.variance is not None or out.color.shape != frame.color.shape):
            expected = f"one of this pipeline with color of shape {frame.color.shape}"
            raise ValueError(f"out: expected {expected}, got one of shape {out.color.shape}")
        output = self._alone(frame) if self._stages is None else self._between(frame, *self._stages)
        if out is None:
            return output
        kept = [getattr(out, name) for name in ("color", "history_length", "confidence", "rejection")]
        made = output.color, output.history_length, output.confidence, output.rejection
        for array, new in zip(kept, made, strict=True):
            array[...] = new
        return Output(*kept, used=output.used, missing=output.missing)

    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""
        for stage in self._stages or ():
            stage.reset()
        self._forget()

    def _forget(self) -> None:
        self._continues = False
        self._evidence: NDArray[np.float32] | None = None

    def _alone(self, frame: Frame) -> Output:
        seen = np.isfinite(frame.color).all(-1)
        return Output(
            self._network.denoise(present(frame), frame),
            np.asarray(seen, np.float32),
            np.zeros(frame.shape, np.float32),
            np.zeros(frame.shape, np.uint8),
            used=self._network.guides,
            missing=int(seen.size - seen.sum()),
        )

    def _between(self, frame: Frame, history: SVGF, antialiasing: TAA) -> Output:
        known = history.step(frame)
        color = self._network.denoise(known.color, frame)
        if self._corrects and self._continues:
            carried = (color, known.history_length, self._evidence, known.motion)
            found, self._evidence = innovation(frame.color, *carried, exposure=exposure(color), fed_back=False)
            color = (color + found).clip(0)
        self._continues = True
        places = {name: getattr(frame, name) for name in ("depth", "position", "camera", "jitter")}
        guides = {name: getattr(frame, name) for name in ("albedo", "normal", "ids")}
        smooth = Frame(color, motion=known.motion, **places, **guides)
        clean = antialiasing.step(smooth, samples=frame.color, confidence=known.confidence)
        return Output(
            clean.color,
            known.history_length,
            known.confidence,
            known.rejection,
            used=tuple(dict.fromkeys((*known.used, *self._network.guides))),
            missing=known.missing,
        )


def _finite(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(np.isfinite(image), image, np.float32(0))


class Network:
    """An Open Image Denoise filter in one quality. It reads and writes arrays in place."""

    def __init__(self, quality: str) -> None:
        try:
            from mitsuba_oidn import Device, DeviceType, Quality
        except (ImportError, OSError) as error:
            raise ImportError(f"mitsuba-oidn not installed ({error}): pip install 'yester[oidn]'") from error
        qualities = {"high": Quality.High, "balanced": Quality.Balanced, "fast": Quality.Fast}
        if quality not in qualities:
            raise ValueError(f"quality: expected one of {', '.join(qualities)}, got {quality}")
        device = Device(DeviceType.CPU)
        # A pool of its own: by default the device would run in Dr.Jit's, which has as many threads as the machine.
        device.num_threads = settings()[0]
        self._filter = device.new_filter("RT")
        self._filter.hdr = True
        self._filter.quality = qualities[quality]
        #: The buffers that were used beside colour.
        self.guides: tuple[str, ...] = ()

    def denoise(self, color: NDArray[np.float32], frame: Frame) -> NDArray[np.float32]:
        """Denoise a finite image with the frame's albedo and normals as guides."""
        self.take(color, frame)
        return self.run()

    def take(self, color: NDArray[np.float32], frame: Frame) -> None:
        """Set the inputs of `run`, and a new output."""
        guides = {}
        if frame.albedo is not None:
            guides["albedo"] = _finite(frame.albedo).clip(0, 1)
            # The network accepts normals only together with albedo.
            if frame.normal is not None:
                guides["normal"] = _finite(frame.normal)
        for name in self.guides:
            if name not in guides:
                self._filter.unset_image(name)
        self.guides = tuple(guides)
        self._output = np.empty_like(color)
        for name, image in {"color": color.clip(0), **guides, "output": self._output}.items():
            self._filter.set_image(name, image)

    def run(self) -> NDArray[np.float32]:
        """Run the network; without another `take`, the next run overwrites the result."""
        self._filter.execute()
        return self._output
