"""Naming conventions as data: which channels of an EXR file hold which buffer, and in what form.

A channel's name is its layer and, behind the last dot, its component; a layer may have any prefix (the view layer of
Blender, a render pass). Each renderer is one `Convention`: how its files are recognised, and one `Layer` for each
buffer it can hold. Layers are written as they are documented: ``"Normal.XYZ"`` for the components X, Y and Z of the
layer Normal, ``"RGB"`` for components without a layer, ``"Px,Py,Pz"`` for channels that are named in full, and
``"CryptoObject##.RGBA"`` for the numbered ranks of a cryptomatte.

What is marked as inferred is what a renderer's users observe, not what its documentation or sources say; so are the
attributes by which the files of Arnold, RenderMan, V-Ray and Unreal are recognised.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import chain, takewhile
from typing import Any

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


@dataclass(frozen=True)
class Form:
    """The form in which a buffer is stored; by default, the canonical one.

    Attributes
    ----------
    unit : str
        Of motion: ``"pixels"``, ``"uv"`` (fractions of the image's sides) or ``"ndc"`` (-1 to 1 over the image).
    scale : tuple of float
        One factor for each component, applied first; for motion, -1 turns an axis. Empty for none.
    space : str
        Of normals and positions: ``"world"``, ``"camera"`` (+X right, +Y up, +Z forward), or ``"either"``, which is
        decided by the space in which positions lie on the screen.
    kind : str
        Of depth: ``"z"`` along the camera axis, or ``"distance"`` along the ray.
    near : float
        Distance of the near plane, if depth is counted from there.
    miss : str
        Depth of a pixel in which nothing was hit: ``"inf"``, ``"far"`` (1e9 and beyond) or ``"zero"`` (or far).
    cryptomatte : bool
        Ids are ranks of a cryptomatte: id and coverage in turn.
    index : bool
        Ids are numbers that users give to objects, which have 0 without one.
    """

    unit: str = "pixels"
    scale: tuple[float, ...] = ()
    space: str = "world"
    kind: str = "z"
    near: float = 0.0
    miss: str = "inf"
    cryptomatte: bool = False
    index: bool = False


#: The values of each property of a form that has a fixed set of them.
VALUES: dict[str, tuple[str, ...]] = {
    "unit": ("pixels", "uv", "ndc"),
    "space": ("world", "camera"),
    "kind": ("z", "distance"),
    "miss": ("inf", "zero", "far"),
}


@dataclass(frozen=True)
class Layer:
    """One way in which a renderer stores a buffer.

    Attributes
    ----------
    buffer : str
        Of a `Frame`.
    names : tuple of str
        Layers with their components; the first one in a file counts.
    form : Form
    plus : tuple of str
        Layers of which the first one in the file is added, if there is one.
    target : str
        The layer that a result replaces, if there is one; otherwise, the one it was made of.
    note : str
        What `yester info` tells of it.
    """

    buffer: str
    names: tuple[str, ...]
    form: Form = field(default_factory=Form)
    plus: tuple[str, ...] = ()
    target: str = ""
    note: str = ""


@dataclass(frozen=True)
class Convention:
    """A renderer: how its files are recognised, and its layers.

    Attributes
    ----------
    renderer : str
    header : tuple of str
        Regular expressions, each for a whole attribute as ``name=value``; any of them is enough.
    marks : tuple of str
        Layers that the files of no other renderer have.
    layers : tuple of Layer
        Of one buffer, the first one in the file counts.
    unused : dict of str to str
        Layers that are recognised but not used unless they are mapped, with the reason.
    averaged : bool
        Normals are means over a pixel's samples, and shorter than one at edges.
    """

    renderer: str
    header: tuple[str, ...] = ()
    marks: tuple[str, ...] = ()
    layers: tuple[Layer, ...] = ()
    unused: Mapping[str, str] = field(default_factory=dict)
    averaged: bool = False


_NO_METHOD = "which no method uses"
_NO_VARIANCE = "a variance or error estimate, which no method uses"

OURS = Convention(
    "yester",
    layers=tuple(
        Layer(buffer, (",".join(channels), *([",".join(channels[:2])] if buffer.startswith("motion") else [])))
        for buffer, channels in CANONICAL.items()
    ),
)

#: Names that users give to layers: those of Mitsuba's integrator are free.
COMMON = Convention(
    "common names",
    layers=(
        Layer("albedo", ("alb.RGB",)),
        Layer("normal", ("sh_normal.XYZ", "nn.XYZ", "ns.XYZ", "n.XYZ", "geo_normal.XYZ", "ng.XYZ")),
        Layer("depth", ("dd.y.Z", "dd.Z")),
        Layer("ids", ("shape_index.I", "si.I", "id.I")),
        Layer("position", ("pos.XYZ", "p.XYZ")),
    ),
)

_CYCLES = Convention(
    "Blender Cycles",
    header=(r"BlenderMultiChannel=.*", r"Software=Blender.*", r"cycles\..*"),
    marks=(
        *("Combined.RGB", "Noisy Image.RGB", "Vector.XYZW", "Denoising Albedo.RGB", "Denoising Normal.XYZ"),
        *("IndexOB.X", "IndexMA.X", "Object Index.X", "Material Index.X", "DiffCol.RGB", "Diffuse Color.RGB"),
    ),
    layers=(
        Layer(
            "color",
            ("Noisy Image.RGB",),
            target="Combined.RGB",
            note="rendered, before the renderer denoised it; the result replaces Combined",
        ),
        Layer("color", ("Combined.RGB",)),
        Layer("albedo", ("Denoising Albedo.RGB",)),
        Layer(
            "albedo",
            ("Diffuse Color.RGB", "DiffCol.RGB"),
            note="of the diffuse part alone: metals and glass are filtered with their textures",
        ),
        Layer("normal", ("Normal.XYZ",)),
        # The sources transform it to camera space; that z points forward there is inferred.
        Layer("normal", ("Denoising Normal.XYZ",), Form(space="camera")),
        Layer("depth", ("Depth.Z", "Depth.V"), Form(miss="far")),
        Layer(
            "depth",
            ("Denoising Depth.Z", "Denoising Depth.V"),
            Form(kind="distance", miss="zero"),
            note="the length of the ray; by way of mirrors and glass, the sum of its parts, each times the throughput",
        ),
        # Previous minus current, and current minus next position; y up.
        Layer("motion", ("Vector.XY",), Form(scale=(1, -1)), note="Vector pass of Blender Cycles: turned to y down"),
        Layer(
            "motion_next", ("Vector.ZW",), Form(scale=(-1, 1)), note="Vector pass of Blender Cycles: turned to y down"
        ),
        Layer("ids", ("CryptoObject##.RGBA",), Form(cryptomatte=True)),
        Layer("ids", ("Object Index.X", "IndexOB.X", "Object Index.V", "IndexOB.V"), Form(index=True)),
        Layer("ids", ("CryptoAsset##.RGBA", "CryptoMaterial##.RGBA"), Form(cryptomatte=True)),
        Layer("ids", ("Material Index.X", "IndexMA.X", "Material Index.V", "IndexMA.V"), Form(index=True)),
        Layer("position", ("Position.XYZ",), note="of a pixel's first sample alone"),
        Layer("emission", ("Emission.RGB", "Emit.RGB"), plus=("Environment.RGB", "Env.RGB")),
        Layer("emission", ("Environment.RGB", "Env.RGB")),
    ),
    unused={
        **dict.fromkeys(
            (
                *(f"{part}{kind}.RGB" for part in ("Diff", "Gloss", "Trans") for kind in ("Dir", "Ind")),
                *(
                    f"{part} {kind}.RGB"
                    for part in ("Diffuse", "Glossy", "Transmission")
                    for kind in ("Direct", "Indirect")
                ),
                *("VolumeDir.RGB", "VolumeInd.RGB", "Volume Direct.RGB", "Volume Indirect.RGB"),
            ),
            "a part of the light: methods take the sum",
        ),
        **dict.fromkeys(
            ("GlossCol.RGB", "TransCol.RGB", "Glossy Color.RGB", "Transmission Color.RGB"),
            "a part of the reflectance",
        ),
        **dict.fromkeys(("Debug Sample Count.X", "Sample Count.X"), "a number of samples, which no method uses"),
        **dict.fromkeys(("AO.RGB", "Ambient Occlusion.RGB", "Shadow.RGB", "Shadow Catcher.RGB"), _NO_METHOD),
        **dict.fromkeys(
            ("Mist.Z", "Mist.V", "UV.UVA", "Denoising Roughness.X", "Denoising Specular Albedo.RGB"), _NO_METHOD
        ),
    },
    averaged=True,
)

_PBRT = Convention(
    "pbrt-v4",
    header=(r"renderTimeSeconds=.*",),
    marks=("dzdx,dzdy", "RelativeVariance.RGB", "Ns.XYZ", "Nsx,Nsy,Nsz"),
    layers=(
        Layer("color", ("RGB",)),
        Layer("albedo", ("Albedo.RGB",)),
        Layer("normal", ("Ns.XYZ", "Nsx,Nsy,Nsz", "N.XYZ", "Nx,Ny,Nz"), Form(space="either")),
        # In camera space, which is the default; otherwise computed from positions.
        Layer("depth", ("P.Z", "Pz,"), Form(space="either", miss="zero")),
        Layer("position", ("P.XYZ", "Px,Py,Pz"), Form(space="either")),
    ),
    unused={
        "Variance.RGB": _NO_VARIANCE,
        "RelativeVariance.RGB": _NO_VARIANCE,
        "dzdx,dzdy": "derivatives, which no method uses",
        "u,v": "texture coordinates, which no method uses",
    },
)

_MITSUBA = Convention(
    "Mitsuba",
    header=(r"generatedBy=Mitsuba.*",),
    marks=("*.T",),
    layers=(
        *(Layer("depth", (name,), Form(kind="distance", miss="zero")) for name in ("depth.T", "dd.y.T", "dd.T", "*.T")),
    ),
)

_ARNOLD = Convention(
    "Arnold",
    header=(r"arnold/.*", r"(exr/)?[Ss]oftware=Arnold.*"),
    marks=("motionvector.RG", "motionvector.XY", "diffuse_albedo.RGB", "crypto_object##.RGBA"),
    layers=(
        Layer("color", ("RGB", "RGBA.RGB", "beauty.RGB")),
        Layer(
            "albedo",
            ("diffuse_albedo.RGB",),
            note="of the diffuse part alone: metals and glass are filtered with their textures",
        ),
        Layer("normal", ("N.XYZ", "N.RGB"), note="inferred: in world space"),
        Layer(
            "depth",
            ("Z,", "Z.Z", "Z.R"),
            Form(miss="far"),
            note="inferred: along the camera axis; --map depth.kind=distance if it is not",
        ),
        Layer("position", ("P.XYZ", "P.RGB"), note="inferred: in world space"),
        Layer("ids", ("crypto_object##.RGBA", "crypto_asset##.RGBA", "crypto_material##.RGBA"), Form(cryptomatte=True)),
        Layer("emission", ("emission.RGB",), plus=("background.RGB",)),
    ),
    unused={
        **dict.fromkeys(
            ("motionvector.RG", "motionvector.XY"),
            "its length scales with the shutter, and its sign was not found: map it (yester check finds out)",
        ),
        "variance.RGB": _NO_VARIANCE,
    },
    averaged=True,
)

_RENDERMAN = Convention(
    "RenderMan",
    header=(r"rman.*", r"(PixarRenderMan|renderman).*"),
    marks=("zfiltered,", "zfiltered.Z", "zfiltered.R", "sampleCount,", "sampleCount.R", "mse.RGB", "forward.RG"),
    layers=(
        Layer("color", ("Ci.RGB", "RGB")),
        Layer("albedo", ("albedo.RGB",)),
        Layer("normal", ("normal.RGB", "normal.XYZ"), note="inferred: in world space"),
        Layer(
            "depth",
            ("zfiltered,", "zfiltered.Z", "zfiltered.R"),
            Form(miss="far"),
            note="inferred: along the camera axis; --map depth.kind=distance if it is not",
        ),
    ),
    unused={
        **dict.fromkeys(
            ("forward.RG", "forward.XY", "backward.RG", "backward.XY"),
            "motion to the next or previous frame; its unit was not found: map it (yester check finds out)",
        ),
        **dict.fromkeys(
            (
                *(
                    "mse.RGB",
                    "albedo_var.RGB",
                    "normal_var.RGB",
                    "normal_var.XYZ",
                    "diffuse_mse.RGB",
                    "specular_mse.RGB",
                ),
                *("zfiltered_var,", "zfiltered_var.Z", "zfiltered_var.R", "albedo_mse.RGB"),
            ),
            _NO_VARIANCE,
        ),
        **dict.fromkeys(("sampleCount,", "sampleCount.R"), "a number of samples, which no method uses"),
        **dict.fromkeys(("diffuse.RGB", "specular.RGB"), "a part of the light: methods take the sum"),
    },
    averaged=True,
)

_FALCOR = Convention(
    "Falcor",
    marks=("mvec.XY", "mvec.RG", "posW.XYZ", "posW.RGB", "normW.XYZ", "normW.RGB"),
    layers=(
        Layer("color", ("RGB", "color.RGB")),
        Layer("normal", ("normW.XYZ", "normW.RGB", "faceNormalW.XYZ", "faceNormalW.RGB")),
        Layer("position", ("posW.XYZ", "posW.RGB")),
        Layer("motion", ("mvec.XY", "mvec.RG"), Form(unit="uv")),
    ),
    unused={"mvecW.XYZ": "motion in world space: only that on the screen is used"},
)

_VRAY = Convention(
    "V-Ray",
    header=(r"vray.*",),
    layers=(Layer("color", ("RGB",)),),
    unused=dict.fromkeys(
        ("Velocity.RGB", "velocity.RGB", "Velocity.XYZ", "velocity.XYZ"),
        "motion to the next frame; its unit depends on the settings: map it (yester check finds out)",
    ),
)

_MOONRAY = Convention(
    "MoonRay",
    marks=("motionvec.XY", "motionvec.RG"),
    layers=(Layer("color", ("RGB",)),),
    unused=dict.fromkeys(
        ("motionvec.XY", "motionvec.RG"),
        "motion in -1 to 1, multiplied by alpha; its sign was not found: map it (yester check finds out)",
    ),
)

_UNREAL = Convention(
    "Unreal Movie Render Queue",
    header=(r"unreal/.*",),
    marks=("FinalImageMovieRenderQueue_MotionVectors.RG",),
    layers=(Layer("color", ("RGB",)),),
    unused={
        "FinalImageMovieRenderQueue_MotionVectors.RG": "motion around 0.5; its unit and sign were not found",
    },
)

#: The renderers, in the order in which equal evidence counts.
CONVENTIONS = (_CYCLES, _PBRT, _MITSUBA, _ARNOLD, _RENDERMAN, _FALCOR, _VRAY, _MOONRAY, _UNREAL)

#: Names of layers of colour, in lower case. A part of such a name is colour in files of any renderer.
COLOR_NAMES = {"rgb"} | {
    name.rpartition(".")[0].lower()
    for convention in CONVENTIONS
    for layer in convention.layers
    if layer.buffer == "color"
    for name in layer.names
} - {""}

#: The attribute that names a cryptomatte.
_CRYPTO_NAME = re.compile(r"cryptomatte/[^/]+/name")


@dataclass(frozen=True)
class Found:
    """Where a buffer is in a file, and how it is stored.

    Attributes
    ----------
    channels : tuple of str
        Of its components in order; of a cryptomatte, those of all ranks.
    form : Form
    plus : tuple of str
        Channels to add.
    target : tuple of str
        The channels that a result replaces.
    note : str
    mapped : bool
        By the user.
    """

    channels: tuple[str, ...]
    form: Form = field(default_factory=Form)
    plus: tuple[str, ...] = ()
    target: tuple[str, ...] = ()
    note: str = ""
    mapped: bool = False


@dataclass(frozen=True)
class Recognised:
    """What the names and the header of a file say.

    Attributes
    ----------
    renderer : str
        Empty if it is not known.
    evidence : str
        Why it is that one.
    averaged : bool
        As of its `Convention`.
    buffers : dict of str to Found
    unused : dict of str to str
        Channels that are known but not used, with the reason.
    remarks : tuple of str
        On choices among view layers, and on layers of other renderers.
    """

    renderer: str
    evidence: str
    averaged: bool
    buffers: dict[str, Found]
    unused: dict[str, str]
    remarks: tuple[str, ...]


def recognise(
    names: Mapping[str, str] | Iterable[str],
    header: Mapping[str, Any] | None = None,
    half: Collection[str] = (),
    results: Collection[str] = (),
) -> Recognised:
    """Recognise the renderer and the buffers of a file.

    Parameters
    ----------
    names : mapping of str to str, or iterable of str
        Its channels; as a mapping, to their names without that of a view.
    header : mapping, optional
        Its attributes.
    half : collection of str, optional
        The channels that are half floats.
    results : collection of str, optional
        The channels that hold a result of ours. They are read instead of those that it was made of.

    Returns
    -------
    Recognised
    """
    header = header or {}
    layers = _Layers(names if isinstance(names, Mapping) else {name: name for name in names})
    evidence = [_evidence(convention, layers, header) for convention in CONVENTIONS]
    best = max(range(len(CONVENTIONS)), key=lambda i: evidence[i][0])
    chosen = CONVENTIONS[best] if evidence[best][0] else Convention("")
    prefixes, remarks = _prefixes(layers, (OURS, chosen, COMMON))
    # Ours come first. With the prefix of a renderer's layers, one of our names is that of a user's own layer.
    ours = [(layer, [""]) for layer in OURS.layers if not prefixes[0] or layer.buffer != "color"]
    order = (chosen,) if chosen.renderer and prefixes[0] else (chosen, OURS)
    others = [layer for convention in (*order, COMMON, _cryptomattes(header)) for layer in convention.layers]
    found: dict[str, Found] = {}
    unused: dict[str, str] = {}
    for layer, own in [*ours, *((layer, prefixes) for layer in others)]:
        where = None if layer.buffer in found else _where(layer, layers, own)
        if where and layer.form.cryptomatte and any(name in half for name in where.channels):
            unused |= dict.fromkeys(where.channels, "a cryptomatte in half floats, which cannot hold its ids")
        elif where and where.target != where.channels and all(name in results for name in where.target):
            found[layer.buffer] = replace(where, channels=where.target, note="a result of Yester")
        elif where:
            found[layer.buffer] = where
    for name, why in chosen.unused.items():
        unused |= dict.fromkeys(layers.find(name, prefixes) or (), why)
    for layer in others:
        why = f"another {layer.buffer.replace('_', ' ')}, which is not needed"
        for channel in chain.from_iterable(layers.find(name, prefixes) or () for name in layer.names):
            unused.setdefault(channel, why)
    for channel in layers.alpha(found.get("color")):
        unused[channel] = "alpha: kept as it is"
    used = {name for one in found.values() for name in (*one.channels, *one.plus, *one.target)}
    unused = {channel: why for channel, why in unused.items() if channel not in used}
    if found.get("position") and any(name in half for name in found["position"].channels):
        remarks.append("positions are half floats, true to 1/2000 of their size")
    for convention, (score, _) in zip(CONVENTIONS, evidence, strict=True):
        if score and convention is not chosen:
            remarks.append(f"layers of {convention.renderer} are there as well, and not used")
    return Recognised(
        renderer=chosen.renderer,
        evidence=evidence[best][1],
        averaged=chosen.averaged,
        buffers={buffer: found[buffer] for buffer in CANONICAL if buffer in found},
        unused=unused,
        remarks=tuple(remarks),
    )


def guesses(unknown: Iterable[str], *, color: bool, renderer: str = "") -> dict[str, tuple[str, ...]]:
    """For layers that are not known, a mapping to the buffer whose known names are nearest; colour only if wanted.

    Each is what ``--map`` takes, once or twice: a depth of 1e9 and beyond is taken for that of nothing.

    None for layers that the renderer has in another form, such as those of an unused view layer: channels alone
    would not say in which.
    """
    known = {"normals": "normal", "velocity": "motion_next", "basecolor": "albedo", "distance": "depth"}
    for layer in (layer for convention in (OURS, COMMON, *CONVENTIONS) for layer in convention.layers):
        for name in layer.names:
            known.setdefault(_plain(_parse(name)[0]), layer.buffer)
    own = [layer for convention in CONVENTIONS if convention.renderer == renderer for layer in convention.layers]
    formed = {_parse(name)[0].lower() for layer in own if layer.form != Form() for name in layer.names}
    del known[""]
    layers: dict[str, dict[str, str]] = {}
    for channel in unknown:
        group, _, component = channel.rpartition(".")
        layers.setdefault(group or component, {})[component.upper() if group else ""] = channel
    result: dict[str, tuple[str, ...]] = {}
    for name, channels in layers.items():
        last = name.rpartition(".")[2].lower()
        has_form = bool({last, re.sub(r"\d\d$", "##", last)} & formed)
        near = [] if has_form else get_close_matches(_plain(last), known, 1, 0.75)
        buffer = known[near[0]] if near else None
        if buffer is None or (buffer == "color" and not color):
            continue
        for components in _COMPONENTS.get(buffer, _SCALAR):
            if all(component in channels for component in components):
                mapped = f"{buffer}={','.join(channels[component] for component in components)}"
                result[name] = (mapped, "depth.miss=far") if buffer == "depth" else (mapped,)
                break
    return result


#: The components in which a buffer may be stored, as far as guesses go.
_SCALAR = (("",), ("Z",), ("R",), ("Y",), ("V",), ("X",), ("I",), ("T",))
_COMPONENTS = {
    "color": (("R", "G", "B"),),
    **dict.fromkeys(
        ("albedo", "emission", "replay", "normal", "position", "object_normal"), (("R", "G", "B"), ("X", "Y", "Z"))
    ),
    **dict.fromkeys(("motion", "motion_next"), (("X", "Y"), ("R", "G"), ("U", "V"))),
}


def missing(found: Iterable[str], *, camera: bool) -> dict[str, str]:
    """The consequences of each missing buffer, or camera, given those in `found`."""
    here = {*found, "camera"} if camera else {*found}
    costs = {name: cost for name, cost in COSTS.items() if name not in here}
    guides = [several for name, several in {"normal": "normals", "ids": "ids"}.items() if name in here]
    if "depth" in costs and len(guides) < 2:
        how = f"are detected by {guides[0]} alone, which may leave" if guides else "are not detected, which leaves"
        costs["depth"] = f"disocclusions {how} ghosts"
    if "normal" in costs and "depth" not in here:
        costs["normal"] = "creases are not detected, and blur"
    if "motion" in here:
        costs.pop("position", None)
    elif camera and here & {"depth", "position"}:
        costs["motion"] = "computed from the cameras, for static objects"
    elif "motion_next" in here:
        costs["motion"] = "computed from motion_next of the frame before, but only with later frames"
    return costs


class _Layers:
    """The channels of a file by layer and component."""

    def __init__(self, names: Mapping[str, str]) -> None:
        self.known: dict[str, dict[str, str]] = {}
        for channel, name in names.items():
            layer, _, component = name.rpartition(".")
            self.known.setdefault(layer, {}).setdefault(component, channel)

    def prefixes(self, name: str) -> list[str]:
        """The prefixes under which a layer is in the file, sorted."""
        layer, components = _parse(name)
        layer = layer.replace("##", "00")
        if not layer:
            return sorted(own for own in self.known if self._of(own, components))
        own = [known for known in self.known if f".{known}".endswith(f".{layer}") and self._of(known, components)]
        return sorted(known[: -len(layer)].removesuffix(".") for known in own)

    def find(self, name: str, prefixes: Sequence[str] | None = None) -> tuple[str, ...] | None:
        """The channels of a layer with the first of the prefixes under which it is; by default, with none or any."""
        layer, components = _parse(name)
        if layer == "*":
            return next(filter(None, (self._of(own, components) for own in sorted(self.known))), None)
        if prefixes is None:
            prefixes = ["", *self.prefixes(name)]
        if not layer:
            prefixes = prefixes[:1]
        return next(filter(None, (self._ranks(_joined(one, layer), components) for one in prefixes)), None)

    def alpha(self, color: Found | None) -> list[str]:
        """The alpha of the layers of colour."""
        channels = {*color.channels, *color.target} if color else set()
        layers = [known for known in self.known.values() if channels & {*known.values()}]
        return [channel for known in layers for name, channel in known.items() if name.upper() == "A"]

    def _ranks(self, layer: str, components: tuple[str, ...]) -> tuple[str, ...] | None:
        if "##" not in layer:
            return self._of(layer, components)
        ranks = (self._of(layer.replace("##", f"{rank:02}"), components) for rank in range(100))
        return tuple(channel for rank in takewhile(bool, ranks) for channel in rank or ()) or None

    def _of(self, layer: str, components: tuple[str, ...]) -> tuple[str, ...] | None:
        known = self.known.get(layer, {})
        lower = {name.lower(): channel for name, channel in known.items()}
        channels = [known.get(one) or lower.get(one.lower(), "") for one in components]
        return tuple(channels) if all(channels) else None


def _evidence(convention: Convention, layers: _Layers, header: Mapping[str, Any]) -> tuple[int, str]:
    """How much speaks for a renderer, and the strongest of it. A header counts for more than all layers."""
    marks = [mark for mark in convention.marks if layers.find(mark)]
    for key, value in header.items():
        text = f"{key}={value if isinstance(value, str | int | float) else ''}"
        if any(re.fullmatch(pattern, text, re.DOTALL) for pattern in convention.header):
            return 100 + len(marks), f"header attribute {key}"
    return len(marks), f"channels {' '.join(layers.find(marks[0]) or ())}" if marks else ""


def _parse(name: str) -> tuple[str, tuple[str, ...]]:
    """Layer and components of a layer as the tables have it."""
    if "," not in name:
        layer, _, letters = name.rpartition(".")
        return layer, tuple(letters)
    parts = [part.rpartition(".") for part in name.split(",") if part]
    return parts[0][0], tuple(component for _, _, component in parts)


def _joined(prefix: str, layer: str) -> str:
    return f"{prefix}.{layer}" if prefix and layer else prefix or layer


def _plain(name: str) -> str:
    return re.sub(r"[^a-z]", "", name.lower())


def _prefixes(layers: _Layers, order: Iterable[Convention]) -> tuple[list[str], list[str]]:
    """The prefixes of layers, that of the colour first and, of several, the one with the most buffers; remarks.

    Without one before colour, layers may have any that two buffers share. A single one may be something else, as
    ``key.emission`` is the light of one lamp.
    """
    names = {name: one.buffer for convention in order for one in convention.layers for name in one.names}
    under: dict[str, set[str]] = {}
    for name, buffer in names.items():
        if _parse(name)[0] not in ("", "*"):
            for prefix in layers.prefixes(name):
                under.setdefault(prefix, set()).add(buffer)
    # Components without a layer: with a prefix, they are colour only if other layers have that prefix.
    for prefix in layers.prefixes("RGB"):
        if prefix in under or not prefix:
            under.setdefault(prefix, set()).add("color")
    colored = {prefix: len(buffers) for prefix, buffers in under.items() if "color" in buffers}
    chosen = max(colored, key=lambda prefix: (colored[prefix], not prefix), default="")
    if chosen:
        prefixes = [chosen, ""]
    else:
        prefixes = ["", *sorted(prefix for prefix, buffers in under.items() if prefix and len(buffers) > 1)]
    others = [prefix for prefix, count in colored.items() if prefix != chosen and count > 1]
    shown = ", ".join(other or "those without a prefix" for other in others)
    return prefixes, [f"layers of {chosen or 'no prefix'} are used, not {shown}"] if others else []


def _where(layer: Layer, layers: _Layers, prefixes: Sequence[str]) -> Found | None:
    for name in layer.names:
        channels = layers.find(name, prefixes)
        if channels is not None:
            plus = next(filter(None, (layers.find(other, prefixes) for other in layer.plus)), ())
            target = (layers.find(layer.target, prefixes) if layer.target else None) or channels
            return Found(channels, layer.form, plus, target, layer.note)
    return None


def _cryptomattes(header: Mapping[str, Any]) -> Convention:
    """The cryptomattes that a header declares, whatever renderer wrote them; objects first."""
    names = [str(value) for key, value in header.items() if _CRYPTO_NAME.fullmatch(key)]
    names.sort(key=lambda name: ("object" not in name.lower(), "asset" not in name.lower(), name))
    return Convention("", layers=tuple(Layer("ids", (f"{name}##.RGBA",), Form(cryptomatte=True)) for name in names))
