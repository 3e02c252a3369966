"""Pictures for screens: PNG files and animations of linear images, with exposure and a tone curve."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import chain
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from tempfile import TemporaryFile
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..metrics import srgb
from .files import beside

__all__ = ["CURVES", "displayed", "write_animation", "write_png"]

Curve = Literal["clip", "reinhard", "aces"]

#: Images a second that both formats hold.
_SLOWEST, _FASTEST = 0.001, 1000.0
#: The largest side of a WebP file.
_WEBP = 16383


def _reinhard(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return x / (1 + x)


def _aces(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


#: Tone curves by name, from linear values, 0 and more, to linear values that are clipped to 1.
CURVES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "clip": lambda x: x,
    "reinhard": _reinhard,
    "aces": _aces,
}


def displayed(image: ArrayLike, *, exposure: float = 0.0, curve: Curve = "clip") -> NDArray[np.uint8]:
    """Encode a linear image for a display: exposure, tone curve, sRGB, 8 bits.

    Parameters
    ----------
    image : (H, W, 3) array_like of float
        Linear, unclamped. NaN is shown as black, infinity as white.
    exposure : float, default 0.0
        In stops: values are multiplied by ``2**exposure``.
    curve : {"clip", "reinhard", "aces"}, default "clip"
        ``clip`` leaves values as they are, and clips at 1; ``reinhard`` is x / (1 + x) per channel; ``aces`` is
        x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14) per channel.

    Returns
    -------
    (H, W, 3) ndarray of uint8
        sRGB.

    Raises
    ------
    ValueError
        If the shape or the curve is none of these, or exposure is not finite.

    References
    ----------
    Reinhard et al. 2002, *Photographic Tone Reproduction for Digital Images*, equation 3; Narkowicz 2016, *ACES Filmic
    Tone Mapping Curve*; IEC 61966-2-1 for sRGB.

    Examples
    --------
    >>> displayed([[[0.0, 0.5, 4.0]]], exposure=-1).tolist()
    [[[0, 137, 255]]]
    """
    linear = np.asarray(image, np.float64)
    if linear.ndim != 3 or linear.shape[2] != 3 or linear.size == 0:
        raise ValueError(f"image: expected shape (H, W, 3), got {linear.shape}")
    if curve not in CURVES:
        raise ValueError(f"curve: expected one of {', '.join(CURVES)}, got {curve}")
    if not np.isfinite(exposure):
        raise ValueError(f"exposure: expected a finite number of stops, got {exposure}")
    # Beyond these, all curves are at their end.
    bounded = np.nan_to_num(linear, nan=0, posinf=1e30, neginf=0).clip(0, 1e30)
    with np.errstate(over="ignore"):
        scaled = bounded * 2.0 ** min(exposure, 1000)
    return encoded(CURVES[curve](scaled.clip(0, 1e30)))


def encoded(values: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """The sRGB bytes of linear values, of any shape; 0 for NaN."""
    return np.asarray(srgb(np.nan_to_num(values, nan=0)) * 255 + 0.5).astype(np.uint8)


def write_png(path: str | os.PathLike[str], image: ArrayLike, *, exposure: float = 0.0, curve: Curve = "clip") -> None:
    """Write a linear image as a PNG file in sRGB, 8 bits.

    The file appears when it is complete: it is written beside and then renamed.

    Parameters
    ----------
    path : path-like
        A file in an existing folder; overwritten if it exists.
    image : (H, W, 3) array_like of float
        Linear.
    exposure : float, default 0.0
    curve : {"clip", "reinhard", "aces"}, default "clip"
        As for `displayed`.

    Raises
    ------
    ValueError
        As `displayed`.
    OSError
        If the file cannot be written.
    ImportError
        If Pillow is not installed.
    """
    picture = _pillow().fromarray(displayed(image, exposure=exposure, curve=curve))
    with beside(Path(path)) as temporary:
        picture.save(temporary, "png")


def check_rate(fps: float) -> None:
    """Refuse frames a second that no animation can have."""
    if not _SLOWEST <= fps <= _FASTEST:
        raise ValueError(f"fps: expected {_SLOWEST:g} to {_FASTEST:g}, got {fps}")


def write_animation(
    path: str | os.PathLike[str],
    images: Iterable[ArrayLike],
    *,
    fps: float = 24.0,
    exposure: float = 0.0,
    curve: Curve = "clip",
) -> None:
    """Write linear images as an animation.

    The file appears when it is complete.

    Parameters
    ----------
    path : path-like
        A name that ends in ``.webp`` (played by browsers, and repeated; by Pillow) or ``.mp4`` (H.264, by ffmpeg, which
        the package imageio-ffmpeg brings). Overwritten if it exists.
    images : iterable of (H, W, 3) array_like of float
        Linear, of one size. May be a generator; for ``.mp4`` only one is held at a time.
    fps : float, default 24.0
        Images a second, 0.001 to 1000: WebP counts in milliseconds, of which it has 24 bits.
    exposure : float, default 0.0
    curve : {"clip", "reinhard", "aces"}, default "clip"
        As for `displayed`.

    Raises
    ------
    ValueError
        If the name ends otherwise, there are no images, they differ in size, or fps is out of range; and as
        `displayed`.
    OSError
        If the file cannot be written.
    ImportError
        If Pillow or imageio-ffmpeg is not installed.

    Notes
    -----
    WebP has quality 90 and H.264 a constant rate factor of 16; both store colour at half resolution. The last row or
    column of an odd size is repeated in H.264, which needs even sizes.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".webp", ".mp4"):
        raise ValueError(f"{path}: expected a name that ends in .webp or .mp4")
    check_rate(fps)

    def pictures() -> Iterable[NDArray[np.uint8]]:
        size = None
        for image in images:
            picture = displayed(image, exposure=exposure, curve=curve)
            if size not in (None, picture.shape):
                raise ValueError(f"images: expected shape {size} as before, got {picture.shape}")
            size = picture.shape
            if kind == ".webp" and max(size[:2]) > _WEBP:
                raise ValueError(f"images: expected at most {_WEBP} pixels a side for WebP, got {size[1]} x {size[0]}")
            yield picture

    made = iter(pictures())
    first = next(made, None)
    if first is None:
        raise ValueError("images: expected at least one, got none")
    film = chain([first], made)
    with beside(path) as temporary:
        if kind == ".webp":
            start, *others = map(_pillow().fromarray, film)
            form = {"save_all": True, "append_images": others, "duration": 1000 / fps, "loop": 0, "quality": 90}
            start.save(temporary, "webp", **form)
        elif reason := _mp4(temporary, first.shape, film, fps):
            raise OSError(f"{path}: cannot be written: {reason}")


def _mp4(path: Path, shape: tuple[int, ...], pictures: Iterable[NDArray[np.uint8]], fps: float) -> str:
    """Write H.264; returns what ffmpeg says if it fails."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ImportError("H.264 needs imageio-ffmpeg: pip install 'yester[video]'") from error
    height, width, _ = shape
    odd = (0, height % 2), (0, width % 2), (0, 0)
    size = f"{width + width % 2}x{height + height % 2}"
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{fps:g}", "-i", "-"]
    # The encoder takes them from the frames alone.
    tags = "setparams=colorspace=bt709:color_primaries=bt709:color_trc=iec61966-2-1"
    coded = ["-vf", f"scale=out_color_matrix=bt709,{tags}", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "16"]
    # The temporary file's name does not tell the format.
    made = ["-movflags", "+faststart", "-fflags", "+bitexact", "-f", "mp4", "-y", f"file:{path}"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", *given, *coded, *made]
    with TemporaryFile() as said, Popen(command, stdin=PIPE, stdout=DEVNULL, stderr=said) as ffmpeg:
        assert ffmpeg.stdin is not None
        with suppress(BrokenPipeError), ffmpeg.stdin as pipe:
            for picture in pictures:
                pipe.write(np.pad(picture, odd, "edge").tobytes())
        if not (failed := ffmpeg.wait()):
            return ""
        said.seek(0)
        words = " ".join(said.read().decode(errors="replace").split())
        return words.replace(str(path), "the file") or f"ffmpeg has ended with {failed}"


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError("pictures need Pillow: pip install 'yester[picture]'") from error
    return Image
