"""Writes small stores in the layout of Noisebase's training and test sets, from the sequence that tests render."""

import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

import flight
import numcodecs
import numpy as np
import zarr
from numpy.typing import NDArray

SAMPLES = 4


def encode(color: NDArray[np.float32]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Code (3, ...) colours: three mantissas and an exponent in 8 bits; and the range of the logarithms."""
    bright = np.log(np.maximum(color.max(0), 1e-30))
    seen = color > 0
    low, high = np.log(color[seen].min()), np.log(color[seen].max())
    exponent = np.clip(np.floor((bright - low) / (high - low) * 256), 0, 255)
    scale = np.exp((exponent + 1) / 256 * (high - low) + low)
    mantissa = np.rint(np.minimum(color / scale * 255, 255))
    return np.concatenate([mantissa, exponent[None]]).astype(np.uint8), np.array([low, high], np.float32)


def offset(frame: int) -> tuple[int, int]:
    """Row and column of the window: it moves from frame to frame."""
    return 5 + frame, 9 + 2 * frame


def arrays(frame: int, size: tuple[int, int], window: tuple[int, int], seed: int = 0) -> dict[str, NDArray[Any]]:
    """One frame's arrays, without the axis of frames. `size` is that of the image, `window` of its part, (H, W)."""
    shot = flight.shoot(frame, size[1], size[0])
    top, left = offset(frame) if window != size else (0, 0)
    cut = np.s_[top : top + window[0], left : left + window[1]]
    rng = np.random.default_rng([seed, frame])
    noise = rng.exponential(1, (*window, SAMPLES)).astype(np.float32)

    def planes(image: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.repeat(np.moveaxis(image[cut], -1, 0)[..., None], SAMPLES, -1)

    position = shot.position.astype(np.float64)
    moved = np.zeros_like(position)
    one = shot.ids == flight.MOVER
    back = flight.transforms(frame)[flight.MOVER]
    moved[one] = position[one] @ back[:3, :3].T + back[:3, 3] - position[one]
    color, exposure = encode(planes(shot.color) * noise)
    return {
        "color": color,
        "exposure": exposure,
        "reference": np.moveaxis(shot.color[cut], -1, 0).astype(np.float32),
        "position": planes(np.nan_to_num(shot.position)),
        "motion": planes(moved.astype(np.float32)),
        "normal": planes(shot.normal).astype(np.float16),
        "diffuse": planes(shot.albedo).astype(np.float16),
        "camera_position": np.asarray(shot.camera.position, np.float32),
        "camera_target": np.asarray(shot.camera.position + shot.camera.forward, np.float32),
        "camera_up": np.array([0, 1, 0], np.float32),
        "view_proj_mat": np.asarray(shot.camera.world_to_clip.T, np.float32),
        "proj_mat": np.eye(4, dtype=np.float32),
        "crop_offset": np.array([top, left], np.int32),
    }


def save(path: Path, named: dict[str, NDArray[Any]], *, single: bool = False) -> None:
    """Zarr 2 in a zip file; LZ4HC, a chunk for each frame and every four samples."""
    store = zarr.storage.ZipStore(path, mode="w")
    root = zarr.create_group(store, zarr_format=2)
    for name, values in named.items():
        chunks = values.shape if single else (1, *values.shape[1:])
        codec = numcodecs.Blosc(cname="lz4hc", clevel=9)
        array = root.create_array(name, shape=values.shape, chunks=chunks, dtype=values.dtype, compressors=codec)
        array[...] = values
    store.close()


def training(
    path: Path,
    frames: int = 4,
    size: tuple[int, int] = (54, 96),
    window: tuple[int, int] = (32, 40),
    empty: Collection[int] = (),
) -> None:
    """A store of a sequence; in `empty` frames, nothing was hit."""
    made = [arrays(frame, size, window) for frame in range(frames)]
    for frame in empty:
        made[frame]["normal"] *= 0
    save(path, {name: np.stack([each[name] for each in made]) for name in made[0]})


def single_frames(folder: Path, frames: int = 3, size: tuple[int, int] = (54, 96)) -> None:
    """A folder of stores of single frames."""
    folder.mkdir(parents=True)
    for frame in range(frames):
        save(folder / f"frame{frame:04}.zip", arrays(frame, size, size), single=True)


if __name__ == "__main__":
    training(Path(sys.argv[1]))
