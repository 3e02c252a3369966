"""Open Image Denoise, a neural network, as a pipeline."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from ._core import (
    SVGF,
    TAA,
    Output,
    Pipeline,
    choice,
    compare_candidates,
    exposure,
    innovation,
    repetition,
    reproject,
    settings,
)
from .frame import Frame, present
from .judge import REPEATS, light

#: Most radiance that the network gets, in times of the exposure, the largest half-precision number: a broken pixel of
#: 1e20 would brighten all others.
_BRIGHTEST = 65504.0

__all__ = ["OIDN", "Network"]


class OIDN(Pipeline):
    """Intel's Open Image Denoise, with albedo and normals where frames have them; alone, or between temporal stages.

    The network processes single images, so that its errors flicker. With `temporal`, its input is the colour
    accumulated by `SVGF`, and `TAA` with preset "denoised" follows. Where history misleads more than it helps, as
    where light moves or in reflections of large frames, up to half of the image of the frame's own samples is mixed in.

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
    choice : bool, default True
        With `temporal`, also denoise the frame's own samples, and show of both images what predicts samples best. The
        network runs twice.

    Raises
    ------
    ImportError
        If the package mitsuba-oidn is not installed or cannot be loaded.
    TypeError
        If one of the others is no bool.
    ValueError
        If the quality is unknown; if `fireflies` is set without `temporal`.

    See Also
    --------
    SVGF : Denoises without a network.

    Notes
    -----
    The network is the filter "RT" of Intel's Open Image Denoise [1]_. `temporal` consists of
    ``SVGF(alpha=0.05, iterations=0, choice=False, innovation=False, antialias=False)``, the network, `choice`,
    `innovation` (with the `exposure` of the network's image, and ``fed_back=False``) and
    ``TAA("denoised", innovation=True)`` with the frame's samples and the `confidence` of SVGF's output, all with its
    `motion`, and gives their bits. Tried and found worse: demodulated input, for the network or for innovation; feeding
    innovation back into the accumulated history; a second accumulation of the network's output. As many threads run as
    ``YESTER_THREADS`` allows.

    With a the network's image of accumulated colour and f that of the frame's samples, the candidates for `choice` are
    a, a + d/4 and a + d/2, with ``d = (f - a) · min(1, (e + lum a) / (e + lum f))²`` and e the `exposure` of a, so that
    what is left of a bright sample does not return. Those of the last frame, reprojected, predict the frame's samples
    (`compare_candidates`), and the best in each tile is shown of this frame's: the first, unless another is better by
    one standard error; the first, too, where the noise is that of the frame before (`repetition`). More than half of f,
    and a default for the whole frame, were tried: PSNR and FLIP are about equal, and relMSE is worse where bright light
    is rare.

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
        choice: bool = True,
    ) -> None:
        given = {"temporal": temporal, "fireflies": fireflies, "innovation": innovation, "choice": choice}
        for name, value in given.items():
            if not isinstance(value, bool | np.bool_):
                raise TypeError(f"{name}: expected a bool, got {type(value).__name__}")
        super().__init__(quality, **given)
        self._network = Network(quality)
        if fireflies and not temporal:
            raise ValueError("fireflies: expected False without temporal, as the network itself removes them, got True")
        history = SVGF(alpha=0.05, iterations=0, choice=False, innovation=False, antialias=False, fireflies=fireflies)
        self._stages = (history, TAA("denoised", innovation=innovation)) if temporal else None
        self._corrects = innovation
        self._chooses = choice
        self._in_step = threading.Lock()
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
        RuntimeError
            If another thread is in a step of this pipeline.
        """
        if not isinstance(frame, Frame):
            raise TypeError(f"frame: expected a yester.Frame, got {type(frame).__name__}")
        if out is not None and not isinstance(out, Output):
            raise TypeError(f"out: expected a yester.Output, got {type(out).__name__}")
        if out is not None and (out.variance is not None or out.color.shape != frame.color.shape):
            expected = f"one of this pipeline with color of shape {frame.color.shape}"
            got = f"one {'with' if out.variance is not None else 'without'} variance, of shape {out.color.shape}"
            raise ValueError(f"out: expected {expected}, got {got}")
        names = ("color", "history_length", "confidence", "rejection")
        kept = {} if out is None else {name: getattr(out, name) for name in names}
        for name, array in kept.items():
            if not array.flags.writeable:
                raise ValueError(f"out.{name}: expected a writable array, got a read-only one")
        with self._exclusive():
            output = self._alone(frame) if self._stages is None else self._between(frame, *self._stages)
        for name, array in kept.items():
            array[...] = getattr(output, name)
        return Output(**kept, used=output.used, missing=output.missing) if kept else output

    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""
        with self._exclusive():
            for stage in self._stages or ():
                stage.reset()
            self._forget()

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Refuse a second thread: the network's images and the history are those of one step."""
        if not self._in_step.acquire(blocking=False):
            raise RuntimeError("OIDN: expected one thread at a time, got a call while another thread is in a step")
        try:
            yield
        finally:
            self._in_step.release()

    def _forget(self) -> None:
        self._continues = False
        self._evidence: NDArray[np.float32] | None = None
        self._mixture = _Mixture()

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
        if self._chooses:
            color = self._mixture.mix(color, self._network.denoise(present(frame), frame), frame, known)
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


#: Shares of the image of the frame's own samples among the candidates.
_SHARES = (0.0, 0.25, 0.5)


class _Mixture:
    """Mixes two images tile by tile, as the last frame's predict the new samples best."""

    def __init__(self) -> None:
        self._before: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        self._evidence: NDArray[np.float32] | None = None
        self._light: NDArray[np.float32] | None = None
        self._deviation: NDArray[np.float32] | None = None

    def mix(
        self, steady: NDArray[np.float32], fresh: NDArray[np.float32], frame: Frame, known: Output
    ) -> NDArray[np.float32]:
        """Mix the images of accumulated colour and of a frame's samples; `known` has the motion and what was found."""
        bright = exposure(steady)
        dimmer = np.minimum(1, (bright + _luminance(steady)) / (bright + _luminance(fresh))) ** 2
        difference = dimmer[..., None] * (fresh - steady)
        before, self._before = self._before, (steady, difference)
        motion, shape = known.motion, frame.shape
        if self._repeats(frame, motion) or before is None or motion is None:
            self._evidence = None
            return steady
        (carried, change), covered = reproject(before, motion, fallback=False)
        covered[known.confidence == 0] = 0
        base, step = _luminance(carried), _luminance(change)
        candidates = np.stack([base + np.float32(share) * step for share in _SHARES], -1)
        candidates[covered == 0] = np.nan
        evidence = self._evidence
        if evidence is not None:
            _, evidence = choice(evidence, motion, covered)
        self._evidence = compare_candidates(frame.color, candidates, evidence, exposure=bright)
        # This frame's evidence counts at once: its samples are not in the candidates.
        still, everywhere = np.zeros((*shape, 2), np.float32), np.ones(shape, np.float32)
        best, _ = choice(self._evidence, still, everywhere, strictness=1.0, frame_strictness=np.inf, share=0.0)
        share = _between_tiles(best, shape) * np.float32(_SHARES[1])
        mixed: NDArray[np.float32] = steady + share[..., None] * difference
        return mixed

    def _repeats(self, frame: Frame, motion: NDArray[np.float32] | None) -> bool:
        """Whether the noise is that of the frame before, which it would predict best of all."""
        # A copy: it may be the caller's array, into which the next frame is written.
        before, self._light = self._light, light(frame).copy()
        if before is None or motion is None:
            return False
        found, self._deviation = repetition(self._light, before, motion, self._deviation)
        return found > REPEATS


def _luminance(color: NDArray[np.float32]) -> NDArray[np.float32]:
    # A product of matrices would not have the same bits on every machine.
    r, g, b = np.moveaxis(color, -1, 0)
    light: NDArray[np.float32] = np.float32(0.2126) * r + np.float32(0.7152) * g + np.float32(0.0722) * b
    return light


def _between_tiles(tiles: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Interpolate between the centres of tiles of 8×8 pixels."""
    for axis, side in enumerate(shape):
        at = ((np.arange(side, dtype=np.float32) + 0.5) / 8 - 0.5).clip(0, tiles.shape[axis] - 1)
        first = at.astype(np.intp)
        part = np.expand_dims(at - first.astype(np.float32), 1 - axis)
        after = np.minimum(first + 1, tiles.shape[axis] - 1)
        near, far = (np.take(tiles, places, axis) for places in (first, after))
        tiles = near + part * (far - near)
    return tiles


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

        def make() -> Any:
            device = Device(DeviceType.CPU)
            # A pool of its own: by default the device would run in Dr.Jit's, which has as many threads as the machine.
            device.num_threads = settings()[0]
            made = device.new_filter("RT")
            made.hdr = True
            made.quality = qualities[quality]
            return made

        self._make = make
        self._filter: Any = make()
        #: The buffers that were used beside colour.
        self.guides: tuple[str, ...] = ()
        _networks.add(self)

    def denoise(self, color: NDArray[np.float32], frame: Frame) -> NDArray[np.float32]:
        """Denoise a finite image with the frame's albedo and normals as guides."""
        self.take(color, frame)
        return self.run()

    def take(self, color: NDArray[np.float32], frame: Frame) -> None:
        """Set the inputs of `run`, and a new output."""
        self._filter = self._filter or self._make()
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
        held = color.clip(0, _BRIGHTEST * exposure(color))
        for name, image in {"color": held, **guides, "output": self._output}.items():
            self._filter.set_image(name, image)

    def run(self) -> NDArray[np.float32]:
        """Run the network; without another `take`, the next run overwrites the result."""
        self._filter.execute()
        return self._output

    def abandon(self) -> None:
        """Have `take` make another device. This one is never freed."""
        if self._filter is not None:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._filter))
        self._filter, self.guides = None, ()


_networks = WeakSet[Network]()


def _forked() -> None:
    """A forked process lacks the threads of its parent's devices. Whatever runs or frees them would wait forever."""
    for network in _networks:
        network.abandon()


if hasattr(os, "register_at_fork"):  # not on Windows, where nothing forks
    os.register_at_fork(after_in_child=_forked)
