"""The compiled half of `yester`; its public names are re-exported there."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self, TypeAlias, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

from .frame import Frame

_Floats: TypeAlias = NDArray[np.float32]
_Doubles: TypeAlias = NDArray[np.float64]
_Threshold: TypeAlias = float | tuple[float, float]
_Filter: TypeAlias = Literal["bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"]
_Box: TypeAlias = Literal["variance", "minmax", "rounded", "intersection", "hull", "exact-hull", "chroma-hull"]
_Space: TypeAlias = Literal["ycocg", "rgb", "tonemapped-ycocg", "tonemapped-rgb"]
_Response: TypeAlias = Literal["center", "clamp", "current", "ellipsoid"]
_Weighting: TypeAlias = Literal["none", "tone", "luminance"]

__all__ = [
    "BMFR",
    "SVGF",
    "TAA",
    "Accumulated",
    "Camera",
    "HalfRes",
    "History",
    "Output",
    "Pipeline",
    "Recirculation",
    "Upscaler",
    "__version__",
    "accumulate",
    "alternation",
    "anti_lag",
    "atrous",
    "blend",
    "blend_factor",
    "canonical",
    "choice",
    "clip_history",
    "combine_histories",
    "compare_candidates",
    "consistency",
    "demodulate",
    "dilate_motion",
    "disocclusion",
    "estimate_variance",
    "exposure",
    "fix_history",
    "innovation",
    "invert_motion",
    "jitter",
    "joint_bilateral_upsample",
    "machine_limits",
    "morphological_aa",
    "motion_vectors",
    "prediction_gain",
    "pull_push",
    "recirculate",
    "reconstruct",
    "regress",
    "remodulate",
    "reproject",
    "resample",
    "resolve",
    "settings",
    "sharpen",
    "splat",
    "suppress_fireflies",
    "temporal_gradient",
    "thin_features",
    "virtual_motion",
]

__version__: str

@final
class Camera:
    def __new__(cls, world_to_clip: ArrayLike, width: int, height: int) -> Self: ...
    @staticmethod
    def from_look_at(
        origin: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        fov: float,
        width: int,
        height: int,
        *,
        fov_axis: Literal["x", "y"] = "x",
        principal_point: ArrayLike | None = None,
    ) -> Camera: ...
    @property
    def world_to_clip(self) -> _Doubles: ...
    @property
    def world_to_camera(self) -> _Doubles: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def position(self) -> _Doubles: ...
    @property
    def forward(self) -> _Doubles: ...
    def project(self, points: ArrayLike) -> tuple[_Doubles, _Doubles]: ...
    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> _Doubles: ...
    def rays(self, pixels: ArrayLike | None = None) -> tuple[_Doubles, _Doubles]: ...
    def jittered(self, offset: ArrayLike) -> Camera: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[type[Camera], tuple[_Doubles, int, int]]: ...

@final
class Accumulated:
    @property
    def color(self) -> _Floats: ...
    @property
    def moments(self) -> _Floats: ...
    @property
    def history_length(self) -> _Floats: ...
    @property
    def missing(self) -> int: ...

@final
class Output:
    def __new__(
        cls,
        color: _Floats,
        history_length: _Floats,
        confidence: _Floats,
        rejection: NDArray[np.uint8],
        *,
        variance: _Floats | None = None,
        choice: _Floats | None = None,
        used: Sequence[str] = (),
        missing: int = 0,
    ) -> Self: ...
    @property
    def color(self) -> _Floats: ...
    @property
    def variance(self) -> _Floats | None: ...
    @property
    def choice(self) -> _Floats | None: ...
    @property
    def history_length(self) -> _Floats: ...
    @property
    def confidence(self) -> _Floats: ...
    @property
    def rejection(self) -> NDArray[np.uint8]: ...
    @property
    def used(self) -> tuple[str, ...]: ...
    @property
    def missing(self) -> int: ...
    def __getnewargs_ex__(self) -> tuple[tuple[NDArray[Any], ...], dict[str, Any]]: ...

@disjoint_base
class Pipeline:
    def __new__(cls, *_args: Any, **_kwargs: Any) -> Self: ...
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...
    def __reduce__(self) -> tuple[Any, tuple[()]]: ...

@final
class History:
    def __new__(
        cls,
        color: ArrayLike,
        moments: ArrayLike,
        history_length: ArrayLike,
        confidence: ArrayLike,
        rejection: ArrayLike,
        *,
        used: Sequence[str] = (),
    ) -> Self: ...
    @property
    def color(self) -> _Floats: ...
    @property
    def moments(self) -> _Floats: ...
    @property
    def history_length(self) -> _Floats: ...
    @property
    def confidence(self) -> _Floats: ...
    @property
    def rejection(self) -> NDArray[np.uint8]: ...
    @property
    def used(self) -> tuple[str, ...]: ...
    def __getnewargs_ex__(self) -> tuple[tuple[NDArray[Any], ...], dict[str, Any]]: ...

@final
class SVGF(Pipeline):
    def __new__(
        cls,
        *,
        alpha: float = 0.2,
        moments_alpha: float = 0.2,
        iterations: int = 3,
        radius: int = 1,
        sigma_luminance: float = 3.0,
        sigma_normal: float = 128.0,
        sigma_depth: float = 1.0,
        sigma_plane: float = 0.01,
        relative_depth: _Threshold = 0.1,
        plane_distance: _Threshold = 0.01,
        normal_angle: _Threshold = 25.0,
        relative_albedo: _Threshold | None = None,
        min_length: float = 3.5,
        feedback: bool = False,
        by_confidence: bool = False,
        gradient: bool = True,
        fireflies: bool = False,
        reflections: Sequence[float] = (0.5, 2.0),
        choice: bool = True,
        innovation: bool = True,
        antialias: bool = True,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None, *, later: History | None = None) -> Output: ...
    def recall(self, frame: Frame) -> History: ...
    def split(self) -> tuple[SVGF, TAA | None]: ...
    def reset(self) -> None: ...

@final
class HalfRes(Pipeline):
    def __new__(
        cls,
        *,
        alpha: float = 0.2,
        weight: float = 0.1,
        radius: int = 2,
        iterations: int = 5,
        sigma_luminance: float = 4.0,
        by_confidence: bool = False,
        fireflies: bool = False,
        reflections: Sequence[float] = (0.5, 2.0),
        choice: bool = False,
        innovation: bool = True,
        antialias: bool = True,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None, *, later: History | None = None) -> Output: ...
    def recall(self, frame: Frame) -> History: ...
    def split(self) -> tuple[HalfRes, TAA | None]: ...
    def reset(self) -> None: ...
    @staticmethod
    def offset(number: int) -> tuple[int, int]: ...

@final
class BMFR(Pipeline):
    def __new__(
        cls,
        *,
        alpha: float = 0.05,
        fitted_alpha: float = 0.1,
        block: int = 16,
        features: Literal["fewest", "all"] = "fewest",
        relative_depth: _Threshold = 0.1,
        plane_distance: _Threshold = 0.01,
        normal_angle: _Threshold = 25.0,
        by_confidence: bool = False,
        gradient: bool = True,
        fireflies: bool = False,
        innovation: bool = True,
        antialias: bool = True,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output: ...
    def reset(self) -> None: ...

@final
class TAA(Pipeline):
    def __new__(
        cls,
        preset: Literal["best", "denoised", "textbook", "karis", "filament"] = "best",
        *,
        alpha: float | None = None,
        fast_alpha: float | None = None,
        speed: _Threshold | None = None,
        dilate: Literal["3x3", "cross", "none"] | None = None,
        filter: _Filter | None = None,
        box: _Box | None = None,
        gamma: float | None = None,
        window: Literal["3x3", "5x5"] | None = None,
        space: _Space | None = None,
        response: _Response | None = None,
        weighting: _Weighting | None = None,
        flicker: float | None = None,
        relative_depth: _Threshold | None = None,
        plane_distance: _Threshold | None = None,
        normal_angle: _Threshold | None = None,
        relative_albedo: _Threshold | None = None,
        ids: bool = False,
        gradient: bool = False,
        anti_lag: float = 0.0,
        alternation: bool = False,
        innovation: bool = False,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output: ...
    def reset(self) -> None: ...

@final
class Recirculation(Pipeline):
    def __new__(
        cls,
        preset: Literal["best", "textbook"] = "best",
        *,
        factor: int | None = None,
        levels: int | None = None,
        nearness: int | None = None,
        history: Literal["splat", "fetch"] | None = None,
        blur: float | None = None,
        share: tuple[float, float] | None = None,
        fade: float | None = None,
        limit: float | None = None,
        tolerance: float | None = None,
        innovation: bool | None = None,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output: ...
    def reset(self) -> None: ...

@final
class Upscaler(Pipeline):
    def __new__(
        cls,
        scale: float = 2.0,
        *,
        alpha: float = 0.06,
        fast_alpha: float = 0.5,
        speed: _Threshold = (0.0, 1.0),
        separation: float = 0.05,
        lifetime: float = 16.0,
        sharpness: float = 0.0,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output: ...
    def reset(self) -> None: ...

def canonical(value: ArrayLike | None, name: str, size: tuple[int, int] | None = None) -> NDArray[Any]: ...
def jitter(count: int, *, sequence: Literal["halton", "r2", "rotated-grid", "blue-noise"] = "halton") -> _Doubles: ...
def motion_vectors(
    geometry: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    ids: ArrayLike | None = None,
    transforms: Mapping[int, ArrayLike] | None = None,
    out: _Floats | None = None,
) -> _Floats: ...
def virtual_motion(
    geometry: ArrayLike,
    hit_distance: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    out: _Floats | None = None,
) -> _Floats: ...
def dilate_motion(
    motion: ArrayLike,
    depth: ArrayLike | None = None,
    *,
    choose: Literal["nearest", "longest"] = "nearest",
    window: Literal["3x3", "cross"] = "3x3",
    out: _Floats | None = None,
) -> _Floats: ...
def invert_motion(
    motion: ArrayLike,
    depth: ArrayLike | None = None,
    *,
    still: ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats: ...
@overload
def reproject(
    history: Sequence[_Floats],
    motion: ArrayLike,
    *,
    filter: _Filter = "bilinear",
    fallback: bool = True,
    dering: bool = True,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    out: tuple[Sequence[_Floats] | None, _Floats | None] | None = None,
) -> tuple[list[_Floats], _Floats]: ...
@overload
def reproject(
    history: ArrayLike,
    motion: ArrayLike,
    *,
    filter: _Filter = "bilinear",
    fallback: bool = True,
    dering: bool = True,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def consistency(
    motion: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    out: tuple[NDArray[np.uint8] | None, _Floats | None] | None = None,
) -> tuple[NDArray[np.uint8], _Floats]: ...
def clip_history(
    history: ArrayLike,
    color: ArrayLike,
    *,
    box: _Box = "variance",
    gamma: float = 1.0,
    window: Literal["3x3", "5x5"] = "3x3",
    space: _Space = "ycocg",
    response: _Response = "center",
    exposure: float = 1.0,
    alpha: float | ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats: ...
def exposure(color: ArrayLike) -> float: ...
def blend_factor(
    confidence: ArrayLike,
    motion: ArrayLike | None = None,
    *,
    alpha: float = 0.05,
    fast_alpha: float = 0.2,
    speed: _Threshold = (0.0, 1.0),
    out: _Floats | None = None,
) -> _Floats: ...
def alternation(
    color: ArrayLike, memory: ArrayLike | None = None, *, exposure: float = 1.0, out: _Floats | None = None
) -> _Floats: ...
def anti_lag(
    history_length: ArrayLike,
    history: ArrayLike,
    clipped: ArrayLike,
    *,
    strength: float = 1.0,
    out: _Floats | None = None,
) -> _Floats: ...
def temporal_gradient(
    color: ArrayLike,
    previous: ArrayLike,
    *,
    noise: float = 2.0,
    passes: int = 3,
    widest: int = 3,
    out: _Floats | None = None,
) -> _Floats: ...
def innovation(
    color: ArrayLike,
    prediction: ArrayLike,
    history_length: ArrayLike,
    evidence: ArrayLike | None = None,
    motion: ArrayLike | None = None,
    *,
    exposure: float = 1.0,
    strictness: float = 3.0,
    share: float = 0.5,
    levels: int = 4,
    fed_back: bool = True,
    sparse: bool = False,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def choice(
    evidence: ArrayLike,
    motion: ArrayLike,
    coverage: ArrayLike,
    *,
    usual: int = 0,
    strictness: float = 0.5,
    share: float = 0.1,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def compare_candidates(
    color: ArrayLike,
    candidates: ArrayLike,
    evidence: ArrayLike | None = None,
    *,
    exposure: float = 1.0,
    usual: int = 0,
    out: _Floats | None = None,
) -> _Floats: ...
def combine_histories(
    color: ArrayLike,
    moments: ArrayLike,
    history_length: ArrayLike,
    other_color: ArrayLike,
    other_moments: ArrayLike,
    other_length: ArrayLike,
    *,
    gradient: ArrayLike | None = None,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats]: ...
def prediction_gain(
    candidate: ArrayLike,
    base: ArrayLike,
    color: ArrayLike,
    *,
    ids: ArrayLike | None = None,
    radius: int = 3,
    out: _Floats | None = None,
) -> _Floats: ...
def blend(
    color: ArrayLike,
    history: ArrayLike,
    alpha: float | ArrayLike = 0.05,
    *,
    weighting: _Weighting = "none",
    flicker: float = 1.0,
    exposure: float = 1.0,
    out: _Floats | None = None,
) -> _Floats: ...
def accumulate(
    color: ArrayLike,
    history: ArrayLike,
    history_moments: ArrayLike,
    history_length: ArrayLike,
    *,
    weight: ArrayLike | None = None,
    gradient: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    alpha: float = 0.05,
    moments_alpha: float = 0.2,
    warmup: bool = True,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> Accumulated: ...
def resample(
    image: ArrayLike,
    size: tuple[int, int],
    *,
    offset: ArrayLike = (0.0, 0.0),
    filter: Literal["lanczos-2", "catmull-rom", "bilinear", "nearest"] = "lanczos-2",
    dering: bool = True,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def disocclusion(
    depth: ArrayLike, motion: ArrayLike, *, separation: float = 0.05, out: _Floats | None = None
) -> _Floats: ...
def thin_features(color: ArrayLike, *, similarity: float = 1.05, out: _Floats | None = None) -> _Floats: ...
def sharpen(
    color: ArrayLike, *, strength: float = 0.5, exposure: float = 1.0, out: _Floats | None = None
) -> _Floats: ...
def resolve(
    samples: NDArray[Any] | Sequence[ArrayLike],
    offsets: ArrayLike,
    *,
    filter: Literal["blackman-harris", "box", "tent", "mitchell"] = "blackman-harris",
    out: _Floats | None = None,
) -> _Floats: ...
def estimate_variance(
    moments: ArrayLike,
    history_length: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    min_length: float = 3.5,
    radius: int = 3,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: _Floats | None = None,
) -> _Floats: ...
@overload
def atrous(
    color: ArrayLike,
    variance: ArrayLike,
    *,
    prediction: None = None,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    iterations: int = 5,
    radius: int = 2,
    sigma_luminance: float = 4.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
@overload
def atrous(
    color: ArrayLike,
    variance: ArrayLike,
    *,
    prediction: ArrayLike,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    iterations: int = 5,
    radius: int = 2,
    sigma_luminance: float = 4.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats]: ...
def regress(
    color: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    geometry: ArrayLike | None = None,
    camera: Camera | None = None,
    weight: ArrayLike | None = None,
    block: int = 32,
    offset: tuple[int, int] = (0, 0),
    features: Literal["fewest", "all"] = "fewest",
    out: tuple[_Floats | None, NDArray[np.uint8] | None] | None = None,
) -> tuple[_Floats, NDArray[np.uint8]]: ...
def splat(
    color: ArrayLike,
    depth: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    offset: ArrayLike | None = None,
    drift: ArrayLike | None = None,
    quality: ArrayLike | None = None,
    tolerance: float = 0.1,
    reach: float = 0.0,
    out: tuple[_Floats | None, _Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats, _Floats]: ...
def pull_push(
    color: ArrayLike,
    quality: ArrayLike | None = None,
    *,
    factor: int = 2,
    levels: int | None = None,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def recirculate(
    filled: ArrayLike,
    filled_quality: ArrayLike,
    reprojected: ArrayLike,
    reprojected_quality: ArrayLike,
    motion: ArrayLike,
    *,
    blur: float = 0.25,
    share: tuple[float, float] = (0.0, 1.0),
    fade: float = 64.0,
    limit: float = 8.0,
    fetch: bool = False,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def suppress_fireflies(
    color: ArrayLike,
    *,
    expected: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    threshold: float = 2.0,
    radius: int = 4,
    redistribute: bool = True,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]: ...
def fix_history(
    color: ArrayLike,
    history_length: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    max_length: float = 3.0,
    stride: float = 14.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: _Floats | None = None,
) -> _Floats: ...
def reconstruct(
    color: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    radius: int = 2,
    sigma: float = 1.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: _Floats | None = None,
) -> _Floats: ...
def joint_bilateral_upsample(
    color: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    camera: Camera | None = None,
    low_depth: ArrayLike | None = None,
    low_normal: ArrayLike | None = None,
    low_ids: ArrayLike | None = None,
    scale: int = 2,
    offset: ArrayLike | None = None,
    radius: int = 2,
    sigma: float = 1.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 1.0,
    sigma_plane: float = 0.01,
    out: _Floats | None = None,
) -> _Floats: ...
def demodulate(
    color: ArrayLike, albedo: ArrayLike, *, emission: ArrayLike | None = None, out: _Floats | None = None
) -> _Floats: ...
def remodulate(
    illumination: ArrayLike, albedo: ArrayLike, *, emission: ArrayLike | None = None, out: _Floats | None = None
) -> _Floats: ...
def morphological_aa(
    color: ArrayLike, *, threshold: float = 0.1, max_length: int = 16, out: _Floats | None = None
) -> _Floats: ...
def machine_limits() -> tuple[float, float]: ...
def settings() -> tuple[int, str]: ...
