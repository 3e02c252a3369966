"""Naming conventions: which channels of an EXR file hold which buffer.

A channel's name is its layer and, behind the last dot, its component. Our own files name layers after the buffers.
Mitsuba names components after the kind of value (a depth is ``T``, an index ``I``) and leaves the names of layers to
the user, so that only common ones can be recognised. Blender Cycles names both motions ``Vector``, behind the name of
the view layer.
"""

from __future__ import annotations

from collections.abc import Iterable

#: The channels of each buffer in this package's files. Those for the change of depth (``motion.Z``) are optional.
CANONICAL: dict[str, tuple[str, ...]] = {
    "color": ("R", "G", "B"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "depth": ("depth.Z",),
    "motion": ("motion.X", "motion.Y", "motion.Z"),
    "ids": ("ids.I",),
    "position": ("position.X", "position.Y", "position.Z"),
    "emission": ("emission.R", "emission.G", "emission.B"),
    "object_normal": ("object_normal.X", "object_normal.Y", "object_normal.Z"),
    "replay": ("replay.R", "replay.G", "replay.B"),
    "hit_distance": ("hit_distance.Z",),
    "reactive": ("reactive.Y",),
    "motion_next": ("motion_next.X", "motion_next.Y", "motion_next.Z"),
}

#: Alternative layer names, as users of Mitsuba choose them; the first match counts.
_SYNONYMS: dict[str, tuple[str, ...]] = {
    "albedo": ("alb",),
    "normal": ("sh_normal", "nn", "ns", "n", "geo_normal", "ng"),
    "depth": ("dd.y", "dd"),
    "ids": ("shape_index", "si", "id"),
    "position": ("pos", "p"),
}

#: Components of the pass ``Vector`` of Blender Cycles, and the signs that convert them to this package's convention.
#: The pass has previous minus current position, then current minus next, in pixels with y up.
_VECTOR: dict[str, tuple[tuple[str, int], ...]] = {
    "motion": (("X", 1), ("Y", -1)),
    "motion_next": (("Z", -1), ("W", 1)),
}

#: Consequences of a missing buffer. Buffers that few renderers write are not reported.
COSTS: dict[str, str] = {
    "color": "nothing to denoise",
    "albedo": "textures are filtered together with the light, and blur",
    "normal": "creases are detected by depth alone, and blur where it is continuous",
    "depth": "disocclusions are detected by normals and ids alone, which may leave ghosts",
    "motion": "history is accumulated in place: correct only for a static camera and scene",
    "ids": "objects that touch may mix",
    "position": "motion can only be computed from depth, as if pixel centres had been hit",
    "emission": "directly visible lights are filtered with the rest, and blur",
    "camera": "no motion from depth or position, and no test of history against the surface's plane",
}


def find(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The channels of each buffer that can be recognised, in the buffer's order of components."""
    names = set(names)
    found = {}
    for buffer, channels in CANONICAL.items():
        components = [name.rpartition(".")[2] for name in channels]
        candidates = [channels]
        if buffer in ("motion", "motion_next"):
            candidates.append(channels[:2])
            layers = sorted(name.removesuffix(".X") for name in names if f".{name}".endswith(".Vector.X"))
            candidates += [tuple(f"{layer}.{component}" for component, _ in _VECTOR[buffer]) for layer in layers]
        for layer in _SYNONYMS.get(buffer, ()):
            candidates.append(tuple(f"{layer}.{component}" for component in components))
        if buffer == "depth":
            candidates += [(f"{layer}.T",) for layer in (buffer, *_SYNONYMS[buffer])]
            candidates += [(name,) for name in sorted(names) if name.endswith(".T")]
        for candidate in candidates:
            if names.issuperset(candidate):
                found[buffer] = candidate
                break
    return found


def signs(buffer: str, channels: Iterable[str]) -> list[int]:
    """Factors by which the channels of a buffer become canonical."""
    turned = {f".Vector.{component}": sign for component, sign in _VECTOR.get(buffer, ())}
    return [next((sign for end, sign in turned.items() if f".{name}".endswith(end)), 1) for name in channels]


def missing(found: Iterable[str], *, camera: bool) -> dict[str, str]:
    """The consequences of each missing buffer, or camera, given those in `found`."""
    here = {*found, "camera"} if camera else {*found}
    costs = {name: cost for name, cost in COSTS.items() if name not in here}
    if "motion" in here:
        costs.pop("position", None)
    elif camera and here & {"depth", "position"}:
        costs["motion"] = "computed from the cameras, for static objects"
    return costs
