"""The pipelines composed of the public kernels, as their documentation defines them; and frames to run them on."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import flight
import numpy as np
import torch
import yester
from numpy.typing import NDArray
from reference.demodulate import is_textured, materials
from reference.taa import PRESETS, for_frame, is_erratic, is_unguided, same_surface, tells_depth, told_by_motion
from yester.study.synthetic import raycast

TILE = 16
#: Every row of tiles tries all reflections in TRIED of PERIOD frames.
PERIOD, TRIED = 16, 2


def sequence(count: int, *, moving=True, size=(61, 43), holes=True, seed=7) -> list[dict]:
    """Noisy frames with every buffer, exact motion, some samples missing; emission on the box; changes of light."""
    rng = np.random.default_rng(seed)
    offsets = yester.jitter(count)
    frames, last = [], None
    for number in range(count):
        shot = flight.shoot(number, *size, moving=moving)
        emission = np.where((shot.ids == flight.BOX)[..., None], np.float32([0.5, 0.4, 0.1]), np.float32(0))
        # Coloured noise: of grey noise the box is flat along chrominance, and rounding would decide what lies in it.
        color = flight.noisy(shot, rng) * rng.uniform(0.9, 1.1, (*shot.ids.shape, 3)).astype(np.float32) + emission
        if holes:
            color[rng.random(shot.ids.shape) < 0.02] = np.nan
            color[10:14, 5 * number : 5 * number + 7, 1] = np.inf
        motion = shot.motion if moving else np.zeros((*shot.shape, 3), np.float32)
        frame = {**shot.buffers(), "color": color, "motion": motion, "emission": emission, "camera": shot.camera}
        turn = flight.mover(number)[:3, :3] if moving else np.eye(3)
        turned = np.where((shot.ids == flight.MOVER)[..., None], shot.normal @ turn, shot.normal)
        turned[30:36, 20:40] *= (-1) ** number  # a change that world normals do not show
        frame["object_normal"] = turned.astype(np.float32)
        replay = np.full_like(color, np.nan) if last is None else last.copy()
        replay[5:25, 8:30] *= 1 + 0.5 * number
        frame["replay"] = replay
        hit = rng.exponential(3, shot.ids.shape).astype(np.float32)
        broken = rng.random(shot.ids.shape) < 0.1
        hit[broken] = rng.choice([np.nan, np.inf, -1], int(broken.sum()))
        frame |= {"hit_distance": hit, "jitter": offsets[number]}
        frames.append(frame)
        last = color
    return frames


def with_white(frames: list[yester.Frame]) -> list[yester.Frame]:
    """Frames whose box is white, the third and the fourth with a white chessboard; all but the sixth without ids."""
    shown = []
    for number, frame in enumerate(frames):
        white = frame.ids == flight.BOX
        if number in (2, 3):
            white = white | (np.indices(frame.shape).sum(0) % 2 == 0)
        albedo = np.where(white[..., None], np.float32(1), frame.albedo)
        shown.append(replace(frame, albedo=albedo, ids=frame.ids if number == 5 else None))
    return shown


def with_highlight(frames: list[yester.Frame]) -> list[yester.Frame]:
    """The frames with an albedo that is no reflectance on the box, in every third frame and the one after it."""
    shown = []
    for number, frame in enumerate(frames):
        lobe = np.geomspace(1e-7, 30, frame.color.shape[1], dtype=np.float32)[None, :, None]
        box = (frame.ids == flight.BOX)[..., None] & (number % 3 > 0)
        shown.append(replace(frame, albedo=np.where(box, lobe, frame.albedo)))
    return shown


def sample(camera: yester.Camera, offset=(0.0, 0.0)) -> dict:
    """Colour and buffers of the scene at rest, without noise, sampled at an offset from the pixel centres."""
    return {**flight.sample(flight.scene(0, camera), offset=offset).buffers(), "camera": camera}


def supersampled(camera: yester.Camera, side: int = 8) -> NDArray[np.float32]:
    """The reference of the scene at rest: the mean over ``side`` × ``side`` samples of each pixel."""
    return raycast.truth(flight.scene(0, camera), side)


def find_still(frame: yester.Frame, before: yester.Frame | None) -> NDArray[np.float32] | None:
    """The cameras' motion, if cameras and geometry are known."""
    geometry = frame.depth if frame.position is None else frame.position
    if geometry is None or before is None or None in (frame.camera, before.camera):
        return None
    return yester.motion_vectors(geometry, frame.camera, before.camera)


def find_motion(frame: yester.Frame, before: yester.Frame | None) -> NDArray[np.float32]:
    """The frame's motion, completed from the cameras; else the cameras' motion; else none."""
    motion, still = frame.motion, find_still(frame, before)
    if motion is None:
        return np.zeros((*frame.color.shape[:2], 2), np.float32) if still is None else still
    if still is None:
        depths = [None if each is None else each.depth for each in (frame, before)]
        known = motion.shape[-1] == 2 and all(depth is not None for depth in depths)
        change = yester.depth_change(*depths, motion) if known else 0
        return np.dstack([motion, np.full(motion.shape[:2], change, np.float32)]) if change else motion
    if frame.position is None:
        missed = np.isposinf(frame.depth) | (frame.depth <= 0)
    else:
        missed = ~np.isfinite(frame.position).all(-1)
    unknown = ~np.isfinite(motion[..., :2]).all(-1) | ((motion[..., :2] == 0).all(-1) & missed)
    filled = motion.shape[-1] == 2 or unknown[::4].any()
    if motion.shape[-1] == 2:
        dx, dy = np.moveaxis(motion - still[..., :2], -1, 0)
        with np.errstate(invalid="ignore"):
            change = np.where(dx * dx + dy * dy <= 0.25, still[..., 2], np.float32(0))
        motion = np.dstack([motion, change])
    return np.where(unknown[..., None], still, motion) if filled else motion


def rests(before: yester.Frame | None, frame: yester.Frame) -> bool:
    """Whether neither the camera nor anything else moves."""
    camera = None if before is None else before.camera
    if frame.motion is None:
        return camera is not None and camera == frame.camera
    return camera == frame.camera and not (np.abs(frame.motion[..., :2]) > 1e-3).any()


def blacken(color: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(np.isfinite(color), color, np.float32(0))


def go_to_nearest(motion: NDArray[np.float32]) -> NDArray[np.float32]:
    """Motion rounded to the centre of the pixel that the filter "nearest" fetches."""
    height, width = motion.shape[:2]
    here = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)
    there = np.floor(here + motion[..., :2] + np.float32(0.5)) - here
    return np.concatenate([there, motion[..., 2:]], -1)


def dilated(settings: dict, motion, depth, still=None) -> NDArray:
    """The motion by which a stage of antialiasing fetches."""
    if settings["dilate"] == "none":
        return motion
    choose = "longest" if depth is None else "nearest"
    among = {"window": settings["dilate"], "margin": settings["dilate_margin"]}
    if not settings["dilate_movers"] and depth is not None:
        among["still"] = still
    return yester.dilate_motion(motion, depth, choose=choose, **among)


class Mixing:
    """How much of the samples and the denoised colour each tile shows instead of the output stage's result."""

    def __init__(self):
        self.luminances = self.samples_before = self.evidence = None
        self.rest = 0

    def scale(self, change: np.float32):
        """Multiply all light."""
        self.luminances, self.samples_before = (
            None if image is None else image * change for image in (self.luminances, self.samples_before)
        )

    def mix(
        self,
        samples: NDArray,
        denoised: NDArray,
        motion: NDArray,
        result: NDArray,
        shown: NDArray,
        *,
        exposure: float,
        repeats: bool,
        aliased: bool,
    ) -> NDArray:
        if repeats:
            self.__init__()
            self.rest = 5
            return shown
        if self.rest > 0:
            self.rest -= 1
            return shown
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            # No sample counts for more than eight times the result; as much as three times the result is shown of it.
            once = np.maximum(luminance(result), np.float32(0)) + np.float32(exposure) / np.float32(16)
            held, samples = (at_most(samples, np.float32(times) * once) for times in (8, 3))
            shares, three = None, [held, denoised, result]
            light = [luminance(image) for image in three]
            if self.luminances is not None:
                fetched, coverage = fetch_known(self.luminances, motion)
                if self.evidence is not None:
                    shares, self.evidence = yester.collocation_shares(self.evidence, motion, coverage)
                    agreed = agree(shares[..., 1] > np.float32(0.05))
                    many = 4 * (shares[..., 0] > np.float32(0.05)).sum() >= agreed.size
                    smooth = many and share_of_all(self.evidence)[0] >= 0.25 and not aliased
                    kept = np.dstack([agreed | (not aliased), agreed])
                    shares = np.where(kept, shares, np.float32(0))
                    if 8 * agreed.sum() < agreed.size and not smooth:
                        self.__init__()
                        self.rest = 5
                        return shown
                if self.samples_before is not None:
                    older, _ = fetch_known(self.samples_before, motion)
                    planes = np.dstack([light[0], fetched[..., 0], older, fetched[..., 1:]])
                    self.evidence = yester.collocate(planes, self.evidence, exposure=exposure)
                self.samples_before = fetched[..., 0]
            self.luminances = np.dstack(light)
            if shares is None:
                return shown
            first, second = (between_tiles(shares[..., c], *shown.shape[:2])[..., None] for c in (0, 1))
            for share, image in ((first, denoised), (second, samples)):
                mixed = shown + share * (image - shown)
                shown = np.where(np.isfinite(mixed).all(-1, keepdims=True), mixed, shown)
        return shown


class Noise:
    """Whether the noise of a sequence's frames repeats."""

    def __init__(self):
        self.before = self.deviation = None

    def repeats(self, color: NDArray, motion: NDArray) -> bool:
        before, self.before = self.before, color
        if before is None:
            return False
        share, self.deviation = yester.repetition(color, before, motion, self.deviation)
        return share > 0.3


def at_most(samples: NDArray, most: NDArray) -> NDArray:
    """Samples of at most a luminance."""
    light = luminance(samples)
    return samples * np.where(light > most, most / light, np.float32(1))[..., None]


def agree(asks: NDArray) -> NDArray:
    """Where at least 3 of 10 tiles ask, of those up to 4 tiles away along each axis."""
    windows = [
        np.lib.stride_tricks.sliding_window_view(np.pad(image.astype(int), 4), (9, 9)).sum((-1, -2))
        for image in (asks, np.ones_like(asks))
    ]
    return 10 * windows[0] >= 3 * windows[1]


def share_of_all(evidence: NDArray) -> NDArray:
    """The shares of denoised colour and samples that would have been best for all tiles together."""
    products, energies = evidence[..., :13].astype(np.float64), evidence[..., [0, 3, 8, 11]].astype(np.float64)
    with np.errstate(invalid="ignore"):
        share = energies[..., :2].sum(-1) / energies.sum(-1)
    products *= np.where(np.isfinite(share), share, 1)[..., None]
    sums = np.append(products.sum((0, 1)), evidence[..., 13].sum(dtype=np.float64))
    one = sums[None, None].astype(np.float32)
    return yester.collocation_shares(one, np.zeros((8, 8, 2)), np.ones((8, 8)), share=0.0)[0][0, 0]


def fetch_known(image: NDArray, motion: NDArray) -> tuple[NDArray, NDArray]:
    """An image of the frame before and its coverage, NaN where it is not covered."""
    fetched, coverage = yester.reproject(image, motion, fallback=False)
    known = coverage > 0 if fetched.ndim == 2 else (coverage > 0)[..., None]
    return np.where(known, fetched, np.float32(np.nan)), coverage


def follows(color: NDArray, old: NDArray, found: list, coverage: NDArray) -> NDArray:
    """Where one history is far nearer than another one to the mean colour of 3×3 pixels."""
    height, width = color.shape[:2]
    padded, mean = np.pad(color, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan), np.zeros_like(color)
    for dy in range(3):
        for dx in range(3):
            mean = mean + padded[dy : dy + height, dx : dx + width]
    mean, exposure = mean / np.float32(9), np.float32(yester.exposure(color))

    def distance(image: NDArray) -> NDArray:
        with np.errstate(all="ignore"):
            one, other = (each / (luminance(each) + exposure)[..., None] for each in (image, mean))
            r, g, b = np.moveaxis(np.abs(one - other), -1, 0)
        return r + g + b

    return (coverage > 0) & (distance(found[0]) < np.float32(0.3) * distance(old))


def shorten_others(length, old, clipped, color, bright) -> NDArray:
    """The lengths of a history that was clipped because it is another surface's."""
    before, light, fresh = luminance(old), luminance(clipped), luminance(color)
    least = np.float32(bright) / np.float32(16)
    with np.errstate(divide="ignore", invalid="ignore"):
        strength = 8 * (light + least) / (np.where(fresh > light, fresh, light) + least)
        moved = strength * (np.abs(before - light) / np.maximum(np.abs(before), np.abs(light)))
        return np.where(moved > 0, 1 / (1 / length + moved), length)


def antialias(
    settings: dict, history, color, motion, depth, still=None, tests=None, others=None, lag=None, clip=None
) -> tuple[list, NDArray, NDArray]:
    """The history merged with one more colour: colour and length, the old history's coverage and rejection."""
    tests, change, memory = tests or {}, None, None
    if history is None:
        old, length = np.zeros_like(color), np.zeros_like(color[..., 0])
        coverage, rejection = length, np.zeros(length.shape, np.uint8)
    else:
        moved = dilated(settings, motion, depth, still)
        known = {"fallback": False, **tests}
        fetches = {"filter": settings["filter"], **known}
        (old, length), coverage = yester.reproject(history[:2], moved, **fetches)
        if settings["alternation"]:
            memory, seen = yester.reproject(history[2], moved, **known)
            memory = np.where((seen > 0)[..., None], memory, np.float32(np.nan))
        footprint = go_to_nearest(moved) if settings["filter"] == "nearest" else moved
        rejection, _ = yester.consistency(footprint, **tests)
        if settings["gradient"]:
            known = np.where((coverage > 0)[..., None], old, np.float32(np.nan))
            change = yester.temporal_gradient(color, known, noise=2.2, passes=3, widest=5)
        if still is not None and not settings["dilate_movers"] and depth is not None:
            other = dilated({**settings, "dilate_movers": True}, motion, depth)
            found = yester.reproject(history[:2], other, **fetches)
            apart = (np.abs(other[..., :2] - moved[..., :2]) > np.float32(0.05)).any(-1)
            taken = apart & follows(color, old, *found)
            old, length = (
                np.where(taken[..., None] if new.ndim == 3 else taken, new, image)
                for new, image in zip(found[0], (old, length), strict=True)
            )
            coverage = np.where(taken, found[1], coverage)
    if lag is not None:
        old, steady = lag(old, coverage)
    among = {name: settings[name] for name in ("box", "gamma", "window", "space", "response")}
    bright = yester.exposure(color)
    clipped, kept = yester.clip_history(old, color, exposure=bright, **among), []
    if settings["alternation"]:
        kept = [yester.alternation(color, memory, exposure=bright)]
        clipped = yester.blend(old, clipped, np.clip(np.nan_to_num(kept[0][..., 6]) - 1, 0, 1))
    if clip is not None:
        clipped = clip.release(old, clipped, steady, bright)
    pace = {name: settings[name] for name in ("alpha", "fast_alpha", "speed")}
    share = yester.blend_factor(coverage, motion, **pace)
    with np.errstate(divide="ignore"):
        longest = np.float32(1) / np.float32(settings["alpha"])
    length = yester.anti_lag(length, old, clipped, strength=settings["anti_lag"])
    if others is not None and history is not None:
        own = (np.abs(moved[..., :2] - motion[..., :2]) <= np.float32(0.05)).all(-1)
        length = np.where(others & own, shorten_others(length, old, clipped, color, bright), length)
    if change is not None:
        square = (1 - change) * (1 - change)
        length = length * (square * square * (square * square) * square)
    counted = np.minimum(length + np.float32(1), longest)
    share = np.maximum(share, 1 / counted)
    if change is not None:
        share = share + change * (1 - share)
    weights = {name: settings[name] for name in ("weighting", "flicker")}
    brighter = settings.get("brighter", 1.0)
    blended = yester.blend(color, clipped, share, exposure=brighter * bright, **weights)
    if clip is not None:
        clip.predict(blended, share)
    present = np.isfinite(color).all(-1)
    return [blended, np.where(present, counted, length), *kept], coverage, rejection


class ClipChoice:
    """Tiles that leave history unclipped where that has predicted the samples of earlier frames better."""

    def __init__(self):
        self.predicted = self.evidence = self.chosen = None

    def scale(self, change: float) -> None:
        if self.predicted is not None:
            self.predicted = self.predicted * np.float32([change, change, 1])

    def judge(self, samples: NDArray, motion: NDArray, exposure: float) -> None:
        if self.predicted is None:
            return
        fetched, coverage = yester.reproject(self.predicted, motion, fallback=False)
        candidates, self.settled = fetched[..., :2], fetched[..., 2]
        if self.evidence is not None:
            _, self.evidence = yester.choice(self.evidence, motion, coverage)
        fresh = np.where((coverage > np.float32(0.9))[..., None], samples, np.float32(np.nan))
        self.evidence = yester.compare_candidates(fresh, candidates, self.evidence, exposure=exposure)
        still, everywhere = np.zeros_like(motion), np.ones_like(coverage)
        self.chosen, _ = yester.choice(self.evidence, still, everywhere, share=0)

    def release(self, old: NDArray, clipped: NDArray, steady: NDArray, exposure: float) -> NDArray:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            apart = old - clipped
            most = np.float32(0.25) * (luminance(clipped) + black_level(exposure))
            off = np.abs(luminance(apart))
            apart = apart * np.where(off > most, most / off, np.float32(1))[..., None]
        self.steady = steady & np.isfinite(apart).all(-1)
        apart = np.where(self.steady[..., None], apart, np.float32(0))
        self.level = np.zeros(steady.shape, np.float32)
        if self.chosen is not None:
            self.level = between_tiles(self.chosen, *steady.shape) * self.settled
        self.apart = luminance(apart)
        return clipped + self.level[..., None] * apart

    def predict(self, merged: NDArray, share: NDArray) -> None:
        light, apart = luminance(merged), self.apart * (1 - share)
        steady = self.steady.astype(np.float32)
        self.predicted = np.dstack([light - self.level * apart, light + (1 - self.level) * apart, steady])


def black_level(exposure: float) -> np.float32:
    return np.maximum(np.float32(exposure) / np.float32(16), np.finfo(np.float32).tiny)


def comparable(
    frame: yester.Frame, coverage: NDArray, others: NDArray | None, color: NDArray, exposure: float
) -> NDArray[np.bool_]:
    """Where samples are compared with a reprojected history of this coverage."""
    shines = luminance(color) > np.float32(6) * np.float32(exposure)
    if frame.emission is not None:
        shines |= (frame.emission > 0).any(-1)
    if frame.depth is not None:
        shines |= ~(np.isfinite(frame.depth) & (frame.depth > 0))
    compared = ~grown(shines, 1) & (coverage > np.float32(0.9))
    return compared if others is None else compared & ~others


def grown(mask: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """A mask and the pixels up to so many away along each axis."""
    around, (height, width) = np.pad(mask, radius), mask.shape
    steps = range(2 * radius + 1)
    return np.any([around[dy : dy + height, dx : dx + width] for dy in steps for dx in steps], 0)


def catch_up(old: NDArray, color: NDArray, compared: NDArray, found: NDArray) -> NDArray[np.float32]:
    """A history corrected where it is compared with samples, no further than to the new colour."""
    with np.errstate(invalid="ignore"):
        corrected = np.clip(correct(old, found), np.minimum(old, color), np.maximum(old, color))
    compared = compared & np.isfinite(old).all(-1) & np.isfinite(color).all(-1)
    return np.where(compared[..., None] & corrected_runs(found), corrected, old)


def find_changed(settings: dict, frame: yester.Frame, before: NDArray | None, motion: NDArray) -> NDArray | None:
    """Where the material has changed since a frame with the `before` albedo; None if nothing tells."""
    if not settings["material_change"] or frame.albedo is None or before is None:
        return None
    return yester.material_change(frame.albedo, before, motion)


class TAA:
    def __init__(self, preset: str = "best", *, innovation: bool = False, fireflies: bool = False, **overrides):
        self.settings, self.innovation, self.fireflies = {**PRESETS[preset], **overrides}, innovation, fireflies
        self.history = self.before = self.evidence = None

    def step(self, frame: yester.Frame) -> SimpleNamespace:
        motion = find_motion(frame, self.before)
        if self.fireflies:
            known = None if self.history is None else yester.reproject(self.history[0], motion, fallback=False)[0]
            frame = hold_down(frame, known)
        color = frame.color
        if self.settings["reconstruct"] and frame.jitter is not None:
            color = yester.resolve([color], [frame.jitter], filter="blackman-harris")
        tests = {} if self.before is None else same_surface(self.settings, frame, self.before, motion)
        still = find_still(frame, self.before)
        before = None if self.before is None else self.before.albedo
        changed = find_changed(self.settings, frame, before, motion)
        given = frame.depth, still, tests, changed
        merged = antialias(for_frame(self.settings, frame), self.history, color, motion, *given)
        self.history, confidence, rejection = merged
        shown, length = self.history[:2]
        shown = blacken(shown)
        if self.innovation and self.before is not None:
            known = {"evidence": self.evidence, "motion": motion, "exposure": yester.exposure(color)}
            found, self.evidence = yester.innovation(frame.color, shown, length, **known, fed_back=False)
            shown = correct(shown, found)
        if self.settings["smooth_edges"]:
            result = shown if self.innovation else self.history[0]
            known = None if changed is None else np.where(changed, np.float32(0), np.float32(1))
            shown = blacken(yester.smooth_edges(result, confidence=known, exposure=yester.exposure(color)))
        self.before = frame
        return SimpleNamespace(
            color=shown,
            history_length=length,
            confidence=confidence,
            rejection=rejection,
            missing=int((~np.isfinite(frame.color).all(-1)).sum()),
        )


#: Where blocks begin, in eighths of their side.
OFFSETS = np.array([(0, 0), (4, 4), (2, 6), (6, 2), (1, 3), (5, 7), (3, 1), (7, 5)])


def guides(frame: yester.Frame, later=None, incoherent: NDArray | None = None) -> dict[str, NDArray | None]:
    """What guides a filter: depth alone where normals and ids are incoherent, motion where nothing else is known."""
    normal, ids = frame.normal, frame.ids
    if incoherent is not None:
        if normal is not None:
            normal = np.where(incoherent[..., None], np.float32(0), normal)
        if ids is not None:
            ids = np.where(incoherent, coarse_ids(frame), ids)
    depth = frame.depth
    unknown = later is None and depth is None and normal is None and ids is None
    if unknown and frame.motion is not None and not is_erratic(frame):
        x, y = np.moveaxis(frame.motion[..., :2], -1, 0)
        speed = np.sqrt(x * x + y * y)  # torch rounds it otherwise
        depth = 1 / (10 + np.where(np.isfinite(speed), speed, np.float32(0)))
    return {"depth": depth, "normal": normal, "ids": ids}


class ToldApart(yester.Frame):
    """A frame with other ids than its own, which say what its albedo is."""

    own: NDArray | None

    @classmethod
    def of(cls, frame: yester.Frame, ids: NDArray | None) -> "ToldApart":
        names = (*yester.frame.BUFFERS, "jitter", "camera")
        told = cls(**{name: getattr(frame, name) for name in names} | {"ids": ids})
        object.__setattr__(told, "own", own_ids(frame))
        return told


def own_ids(frame: yester.Frame) -> NDArray | None:
    return frame.own if isinstance(frame, ToldApart) else frame.ids


def told_apart(frame: yester.Frame, before: yester.Frame | None) -> tuple[yester.Frame, yester.Frame | None]:
    """Two frames, with the kinds of material as ids where they have albedo and no ids."""
    if frame.albedo is None:
        return frame, before
    if before is not None and (own_ids(before) is None) != (frame.ids is None):
        before = ToldApart.of(before, None)
    if frame.ids is not None:
        return frame, before
    guides = {name: to_tensor(getattr(frame, name)) for name in ("normal", "depth")}
    textured = is_textured(kinds_of(frame), **guides)
    ids = yester.material_ids(frame.albedo, normal=frame.normal, depth=frame.depth)
    if before is not None and before.ids is not None:
        kinds = kinds_of(before).clamp(max=2 if textured else 3)
        before = ToldApart.of(before, kinds.numpy().astype(np.uint32))
    return ToldApart.of(frame, ids), before


def kinds_of(frame: yester.Frame) -> torch.Tensor:
    """The kinds of material; white is one, wherever it is."""
    return materials(*(to_tensor(getattr(frame, name)) for name in ("albedo", "normal", "depth")))


def to_tensor(image: NDArray | None) -> torch.Tensor | None:
    return None if image is None else torch.from_numpy(np.ascontiguousarray(image, dtype=np.float32))


def reflects(frame: yester.Frame) -> NDArray | None:
    """Where the albedo is a reflectance; None if nothing tells."""
    return yester.is_reflectance(frame.albedo, own_ids(frame), normal=frame.normal, depth=frame.depth)


def coarse_ids(frame: yester.Frame) -> NDArray:
    """One id for all surfaces, and another one for those whose albedo is no reflectance; 0 stays."""
    mask = None if frame.albedo is None else reflects(frame)
    reflecting = True if mask is None else mask
    return np.where(frame.ids == 0, 0, np.where(reflecting, 2**32 - 2, 2**32 - 3)).astype(np.uint32)


def hold_down(frame: yester.Frame, known: NDArray | None) -> yester.Frame:
    """A frame whose colour has no fireflies."""
    guide = {name: getattr(frame, name) for name in ("depth", "normal", "ids")}
    return replace(frame, color=yester.suppress_fireflies(frame.color, expected=known, **guide)[0])


def without_fireflies(frame: yester.Frame, light: NDArray, known: NDArray, alike: dict) -> NDArray:
    """Suppress fireflies in the remodulated light, as the camera sees it."""
    if frame.albedo is None:
        return yester.suppress_fireflies(light, expected=known, **alike)[0]
    texture = texture_of(frame)
    seen, expected = (yester.remodulate(image, **texture) for image in (light, known))
    return yester.demodulate(yester.suppress_fireflies(seen, expected=expected, **alike)[0], **texture)


#: Pixels of a row that form one span of the correction.
RUN = 160


def corrected_runs(found: NDArray) -> NDArray[np.bool_]:
    """Pixels (H, W, 1) in whose span a correction was found; the others keep their light, even if it is below black."""
    anything = (found != 0).any(-1)
    first = np.arange(0, anything.shape[1], RUN)
    runs = np.logical_or.reduceat(anything, first, axis=1)
    return np.repeat(runs, RUN, axis=1)[:, : anything.shape[1], None]


def variance_of_mean(moments: NDArray, number: NDArray) -> NDArray:
    """The variance of the mean of so many samples, by the moments of their luminance."""
    spread = moments[..., 1] - moments[..., 0] * moments[..., 0]
    spread = np.where(spread > 0, spread, np.float32(0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return spread / np.maximum(number - 1, np.float32(1)) * (1 + np.float32(4) / number)


def luminance(color: NDArray) -> NDArray:
    r, g, b = np.moveaxis(color, -1, 0)
    return np.float32(0.2126) * r + np.float32(0.7152) * g + np.float32(0.0722) * b


def shorten(length: NDArray, gradient: NDArray | None) -> NDArray:
    """Shorten a history whose light has changed."""
    if gradient is None:
        return length
    rest = 1 - np.clip(np.nan_to_num(gradient), 0, 1)
    square = rest * rest
    return length * (square * square * (square * square) * square)


def correct(light: NDArray, found: NDArray, runs: NDArray[np.bool_] | None = None) -> NDArray:
    """Add the correction; light does not fall below black, and missing pixels stay missing."""
    corrected = light + found
    corrected = np.where(corrected < 0, np.float32(0), np.minimum(corrected, np.finfo(np.float32).max))
    return np.where(corrected_runs(found) if runs is None else runs, corrected, light)


def correct_history(color: NDArray, moments: NDArray, found: NDArray, length: NDArray | None = None) -> list[NDArray]:
    """The moments move with the colour; their variance stays. Given its `length`, a young history stays as it is."""
    runs = corrected_runs(found)
    if length is not None:
        found = np.where((length >= 3.5)[..., None], found, np.float32(0))
    corrected = correct(color, found, runs)
    moved = luminance(corrected - color)
    first, second = np.moveaxis(moments, -1, 0)
    shifted = np.stack([first + moved, second + moved * (first + first + moved)], -1)
    return [corrected, np.where(runs, shifted, moments)]


def between_tiles(chosen: NDArray, height: int, width: int) -> NDArray[np.float32]:
    """Bilinear interpolation between the centres of 8×8 tiles."""

    def places(side: int, count: int) -> tuple:
        at = (np.arange(side) + 0.5) / 8 - 0.5
        first = np.floor(at).astype(int)
        part = (at - first).astype(np.float32)
        return first.clip(0, count - 1), (first + 1).clip(0, count - 1), part

    (top, bottom, down), (left, right, across) = map(places, (height, width), chosen.shape)
    rows = chosen[top] + down[:, None] * (chosen[bottom] - chosen[top])
    return rows[:, left] + across * (rows[:, right] - rows[:, left])


def texture_of(frame: yester.Frame) -> dict:
    """Arguments of `demodulate` and `remodulate` for a frame with albedo."""
    return {"albedo": frame.albedo, "where": reflects(frame)}


def illumination(color: NDArray, frame: yester.Frame) -> NDArray:
    """Demodulate a colour with the frame's albedo and emission."""
    if frame.albedo is None:
        return color
    return yester.demodulate(color, **texture_of(frame), emission=frame.emission)


def disowned(before: yester.Frame, frame: yester.Frame) -> NDArray:
    """The ids of the frame before; an unused one where a surface's albedo has become or ceased to be a reflectance."""
    if before.albedo is None or frame.albedo is None or own_ids(frame) is None or before.ids is None:
        return before.ids
    masks = ((each.ids, reflects(each)) for each in (before, frame))
    then, now = (dict(zip(ids.flat, mask.flat, strict=True)) for ids, mask in masks)
    changed = [known for known, kind in now.items() if then.get(known, kind) != kind]
    unused = next(number for number in count() if number not in now)
    return np.where(np.isin(before.ids, changed), np.uint32(unused), before.ids)


def follow_light(sample: NDArray, fetched: list, coverage: NDArray, history: list, mirrored=None) -> tuple[list, list]:
    """Both histories, fetched and not, times what all light has changed by; in place, the light of reflections."""
    change = np.float32(yester.light_change(sample, fetched[0], coverage))
    if change == 1:
        return fetched, history
    if mirrored is not None:
        mirrored.light = mirrored.light * change
    factors = [change, np.float32([change, change * change]), np.float32(1), change]
    return tuple([image * f for image, f in zip(images, factors, strict=False)] for images in (fetched, history))


def relight(replay: NDArray, frame: yester.Frame, lights: list[NDArray], moments: NDArray, *, corrects: bool) -> tuple:
    """Correct a history, its light first, by the replay's change of light; and the gradient of the remainder."""
    now, then = (illumination(color, frame) for color in (replay, frame.color))
    exact = {"noise": 0, "passes": 2, "widest": 2}
    gradient = yester.temporal_gradient(now, then, **exact)
    if not corrects:
        return lights, moments, gradient
    old = lights[0]
    endless, bright = np.full(old.shape[:2], 1e30, np.float32), yester.exposure(old)
    mean, _ = yester.atrous(then, endless, iterations=4, radius=1)
    black = max(np.float32(bright) / np.float32(16), np.finfo(np.float32).tiny)
    light, usual = (np.where(image > 0, image, np.float32(0)) + black for image in (old, mean))
    with np.errstate(invalid="ignore"):
        fresh = old + (now - then) * (light / usual)
    found, _ = yester.innovation(fresh, old, endless, exposure=bright, strictness=1)
    _, moments = correct_history(old, moments, found)
    lights = [correct(light, found) for light in lights]
    then = np.where(corrected_runs(found), then + (lights[0] - old), then)
    rest = yester.temporal_gradient(now, then, **exact)
    return lights, moments, np.maximum(np.float32(0.5) * gradient, rest)


def where_plain(albedo: NDArray, reflected: NDArray, own: NDArray) -> NDArray[np.float32]:
    """The motion of reflections where the albedo of 3×3 pixels is that of the pixel; else the surface's own."""
    light = luminance(albedo)
    height, width = light.shape
    around, plain = np.pad(light, 1, mode="edge"), np.ones(light.shape, bool)
    for dy in range(3):
        for dx in range(3):
            other = around[dy : dy + height, dx : dx + width]
            plain &= np.abs(other - light) <= np.float32(0.1) * np.maximum(light, other)
    return np.where(plain[..., None], reflected, own)


class SVGF:
    def __init__(
        self,
        *,
        alpha=0.2,
        moments_alpha=0.2,
        iterations=3,
        radius=1,
        sigma_luminance=3.0,
        relative_noise=2.5,
        tap_exposure=16.0,
        sigma_normal=64.0,
        sigma_depth=0.5,
        sigma_plane=0.05,
        relative_depth=0.1,
        plane_distance=0.01,
        normal_angle=25.0,
        motion_difference=0.2,
        relative_albedo=None,
        min_length=3.5,
        feedback=False,
        by_confidence=False,
        gradient=True,
        fireflies=False,
        reflections=(0.2, 0.4, 0.7, 1.2),
        choice=True,
        innovation=True,
        antialias=True,
        average_still=False,
        coherence=True,
    ):
        self.alpha, self.average_still = {"alpha": alpha, "moments_alpha": moments_alpha}, average_still
        self.sigmas = {"sigma_normal": sigma_normal, "sigma_depth": sigma_depth, "sigma_plane": sigma_plane}
        self.limits = {
            "relative_depth": relative_depth,
            "plane_distance": plane_distance,
            "normal_angle": normal_angle,
            "motion_difference": motion_difference,
        }
        self.filter = {"radius": radius, "sigma_luminance": sigma_luminance}
        self.relative_noise = np.inf if average_still else relative_noise
        self.tap_exposure = np.inf if average_still else tap_exposure
        self.iterations, self.min_length = iterations, min_length
        self.feedback, self.gradient, self.fireflies = feedback, gradient, fireflies
        self.by_confidence, self.same_albedo = by_confidence, relative_albedo is not None
        if relative_albedo is not None:
            self.limits["relative_luminance"] = relative_albedo
        self.distances, self.innovation, self.antialias = reflections, innovation, antialias
        self.passes, self.stage = 3, {**PRESETS["denoised"], "choice": choice}
        self.stage["unguided_alpha"] = 0.0 if average_still else 0.5
        self.stage["guided_exposure"] *= not average_still
        self.before = self.antialiased = self.albedo = self.mirrored = self.trust = None
        self.mixing = self.clipping = None
        self.evidence = self.lag = self.rest = None
        self.chooses, self.choice, self.coherence = choice, None, coherence
        self.choice_with_albedo, self.strictness, self.fewest, self.settled = True, 0.5, 2.5, 3.5
        self.noise, self.repeats = Noise(), False
        self.still, self.still_frames = None, 0
        self.asked, self.won = [], []  # weights of the pixels, by frame

    def step(self, frame: yester.Frame, later=None) -> SimpleNamespace:
        return self.advance(frame, later, shows=True)

    def recall(self, frame: yester.Frame) -> SimpleNamespace:
        return self.advance(frame, None, shows=False)

    def advance(self, frame: yester.Frame, later, *, shows: bool) -> SimpleNamespace:
        frame, self.before = told_apart(frame, self.before)
        sample = illumination(frame.color, frame)
        held, motion, gradient, mirrored = sample, find_motion(frame, self.before), None, None
        incoherent = None
        still = find_still(frame, self.before)
        moved = seen = motion
        judges = self.chooses and shows and (self.choice_with_albedo or frame.albedo is None)
        if not judges:
            self.noise = Noise()
        self.repeats = judges and self.noise.repeats(sample, motion)
        chooses, min_length = judges and not self.repeats, self.min_length
        averages = self.average_still and rests(self.before, frame) and chooses and frame.replay is None
        patience = np.float32(1)
        if not averages:
            self.still, self.still_frames = None, 0
        elif self.still is not None:
            patience = np.sqrt(np.clip(np.float32(self.still_frames) / np.float32(10), 1, 16, dtype=np.float32))
        if self.repeats:  # history counts for no more than one sample
            min_length = float(np.float32(1) / np.float32(self.alpha["alpha"]) * np.float32(min_length))
        if self.before is None:
            shape = sample.shape[:2]
            history = [np.zeros((*shape, *channels), np.float32) for channels in ((3,), (2,), ())]
            confidence, rejection = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        else:
            tests = self.same_surface(frame, motion)
            cameras = frame.camera, self.before.camera
            reflects = len(self.distances) > 0 and None not in cameras
            changes, replays = [], self.gradient and frame.replay is not None and self.expects_replay
            if replays:
                light, moments, length = self.history
                lights = [light] if self.mirrored is None else [light, self.mirrored.light]
                lights, moments, *changes = relight(
                    frame.replay, self.before, lights, moments, corrects=self.innovation
                )
                self.history = [lights[0], moments, length]
                if self.mirrored is not None:
                    self.mirrored.light = lights[1]
            planes = [*self.history, *changes]
            fetched, confidence = yester.reproject(planes, motion, **tests, **self.limits)
            rejection, _ = yester.consistency(motion, **tests, **self.limits)
            if self.coherence and not (frame.normal is None and frame.ids is None):
                incoherent = yester.incoherent_guides(frame.normal, frame.ids, confidence=confidence)
                others = {**tests, **self.limits, "normal_angle": 180.0}
                if "ids" in tests:
                    others |= {"ids": coarse_ids(frame), "previous_ids": coarse_ids(self.before)}
                again = yester.reproject(planes, motion, **others)
                failed, _ = yester.consistency(motion, **others)
                pairs = zip([*fetched, confidence, rejection], [*again[0], again[1], failed], strict=True)
                *fetched, confidence, rejection = (
                    np.where(incoherent.reshape(incoherent.shape + (1,) * (old.ndim - 2)), new, old)
                    for old, new in pairs
                )
            history, more = fetched[:3], fetched[3:]
            if self.innovation and averages and self.still is not None:
                change = np.float32(yester.light_change(sample, history[0], confidence))
                factors = change, np.float32([change, change * change]), np.float32(1)
                self.still = [image * f for image, f in zip(self.still, factors, strict=True)]
                if "emission" in self.still_guides:
                    self.still_guides["emission"] = self.still_guides["emission"] * change
            if self.innovation and not replays:
                history, self.history = follow_light(sample, history, confidence, self.history, self.mirrored)
        if self.fireflies:
            held = without_fireflies(frame, sample, history[0], guides(frame, later))
        if self.before is not None:
            if replays:
                gradient = more[0]
            elif self.gradient:
                known = np.where((confidence > 0)[..., None], history[0], np.float32(np.nan))
                looks = {"passes": self.passes, "widest": self.passes + 2}
                gradient = yester.temporal_gradient(held, known, noise=float(np.float32(2.4) * patience), **looks)
            if reflects:
                planes = [self.mirrored.light, self.mirrored.scores]
                (light, scores), lit = yester.reproject(planes, motion, **tests, **self.limits)
                light = np.where((lit > 0)[..., None], light, np.float32(np.nan))
                mirrored = self.reflect(frame, tests, history, confidence, light, scores, sample)
                if mirrored is not None:
                    moved = np.where(np.isfinite(mirrored.motion), mirrored.motion, motion[..., :2])
                    seen = moved if frame.albedo is None else where_plain(frame.albedo, moved, motion[..., :2])

        alike = {**guides(frame, later, incoherent), **self.sigmas}
        filled, weight = self.fill(held, history[2], alike)
        trust = confidence if self.by_confidence else None
        shares = dict.fromkeys(self.alpha, 0.0) if self.average_still and rests(self.before, frame) else self.alpha
        merged = yester.accumulate(filled, *history, weight=weight, gradient=gradient, confidence=trust, **shares)
        kept = [merged.color, merged.moments, merged.history_length]
        if averages:
            shape = sample.shape[:2]
            mean = self.still or [np.zeros((*shape, *channels), np.float32) for channels in ((3,), (2,), ())]
            mean = yester.accumulate(frame.color, *mean, gradient=gradient, alpha=0.0, moments_alpha=0.0)
            if self.still is None:
                self.still_guides, self.still_lag = {}, None
            self.still = [mean.color, mean.moments, mean.history_length]
            self.still_frames += 1
            for name in ("albedo", "emission", "normal"):
                fresh = getattr(frame, name)
                if fresh is not None:
                    known = self.still_guides.get(name, fresh)
                    number = np.maximum(mean.history_length, np.float32(1))[..., None]
                    with np.errstate(invalid="ignore"):
                        averaged = np.where(np.isfinite(fresh), known + (fresh - known) / number, known)
                    self.still_guides[name] = np.where(np.isfinite(known), averaged, fresh)
        expected = [*history[:2], shorten(history[2], gradient)]
        recalled = [image.copy() for image in expected]
        color, moments, length = kept
        with np.errstate(divide="ignore", invalid="ignore"):
            longest = np.float32(1) / np.float32(shares["alpha"])
            expected[2] = np.minimum(expected[2], longest - 1)
            if later is not None:
                joins = later.color, later.moments, np.minimum(later.history_length, longest - 1)
                bright = yester.exposure(color)
                expected = yester.combine_histories(*expected, *joins, exposure=bright)
                color, moments, length = yester.combine_histories(*kept, *joins, exposure=bright)
            variance = yester.estimate_variance(moments, length, min_length=min_length, **alike)
            if later is not None:
                variance = variance * np.minimum(longest / length, np.float32(1))

        settles = averages and "albedo" in self.still_guides and self.still_frames >= 16
        young = (kept[2] < 16) & (frame.color > 0).any(-1)
        if settles and later is None and 64 * young.sum() <= young.size:
            self.history, self.mirrored = kept, None
            self.expects_replay, self.before = self.before is None or frame.replay is not None, frame
            final, variance = self.settle(np.zeros_like(color), frame, motion, alone=True)
            return SimpleNamespace(
                color=blacken(final),
                variance=variance,
                choice=np.full(length.shape, self.iterations, np.float32),
                motion=None if self.antialias or not self.distances else motion[..., :2],
                history_length=length,
                confidence=confidence,
                rejection=rejection,
                missing=int((~np.isfinite(sample).all(-1)).sum()),
            )
        usual, shown, prediction = self.iterations, None, None
        bright = yester.exposure(color)
        if chooses:
            prediction, (first, second) = luminance(expected[0]), np.moveaxis(expected[1], -1, 0)
            with np.errstate(invalid="ignore", over="ignore"):
                deviation = np.sqrt(np.fmax(second - first * first, np.float32(0)))
                most = np.float32(1.5) * deviation + np.float32(1e-3) * np.abs(prediction)
                near = luminance(color) - prediction <= most
            prediction = np.where((expected[2] >= self.fewest) & near, prediction, np.float32(np.nan))

        def smooth(passes: int):
            known = {} if prediction is None else {"prediction": prediction}
            if not self.repeats:
                noise = self.relative_noise if is_unguided(frame) else np.inf
                tone = np.float32(self.tap_exposure) * np.float32(bright)
                known |= {"history_length": length, "relative_noise": noise}
                known |= {"tap_exposure": tone, "settled": self.settled}
            return yester.atrous(color, variance, iterations=passes, **known, **self.filter, **alike)

        first, second = (smooth(min(passes, usual))[0] for passes in (1, 2))
        if chooses:
            series = [smooth(passes) for passes in range(min(usual + 1, 16) + 1)]
            # One pass more where there is no history, but not to blur texture.
            samples = length if frame.albedo is not None else np.full_like(length, np.inf)
            known = prediction, sample, moved, confidence, samples, bright
            final, final_variance, shown = self.choose(series, *known)
        else:
            final, final_variance = smooth(usual)
            self.choice = None
            if self.chooses and shows:
                shown = np.full(length.shape, usual, np.float32)
        self.history = [first if self.feedback and later is None else kept[0], *kept[1:]]
        if len(self.distances) > 0:
            self.mirrored = mirrored or SimpleNamespace(scores=None, tiles=None, age=0)
            self.mirrored.light = second
            if self.mirrored.scores is None:
                self.mirrored.scores = np.zeros((*length.shape, 2 * len(self.distances)), np.float32)
        if self.innovation and self.before is not None:
            known = {"evidence": self.evidence, "motion": moved, "exposure": bright}
            found, self.evidence = yester.innovation(sample, final, length, **known)
            final = correct(final, found)
            self.history[:2] = correct_history(*self.history[:2], found)
            if len(self.distances) > 0:
                self.mirrored.light = correct(self.mirrored.light, found)
        if frame.albedo is not None:
            final = yester.remodulate(final, **texture_of(frame), emission=frame.emission)
        self.expects_replay = self.before is None or frame.replay is not None
        self.before = frame
        if not shows:
            self.antialiased = self.albedo = self.lag = self.rest = self.mixing = self.clipping = None
            names = "color", "moments", "history_length"
            known = dict(zip(names, recalled, strict=True))
            return SimpleNamespace(**known, confidence=confidence, rejection=rejection, motion=seen[..., :2])
        if self.antialias:
            chooses_clip = self.stage["clip_choice"] and not (averages and frame.albedo is None)
            stage = {**self.stage, "clip_choice": chooses_clip}
            final = self.finish(stage, final, frame, seen, still, confidence)
        if averages:
            final, _ = self.settle(blacken(final), frame, motion)
        return SimpleNamespace(
            color=blacken(final),
            variance=final_variance,
            choice=shown,
            motion=None if self.antialias or not self.distances else seen[..., :2],
            history_length=length,
            confidence=confidence,
            rejection=rejection,
            missing=int((~np.isfinite(sample).all(-1)).sum()),
        )

    def finish(self, stage: dict, color: NDArray, frame: yester.Frame, motion: NDArray, still, confidence) -> NDArray:
        """The output stage, whose history the samples correct, too."""
        changed, self.albedo = find_changed(stage, frame, self.albedo, motion), frame.albedo
        if changed is not None:
            confidence = np.where(changed, np.float32(0), confidence)
        before, others = self.antialiased, confidence <= 0
        if self.innovation and before is not None:
            fetched, coverage = yester.reproject(before[0], motion, fallback=False)
            change = np.float32(yester.light_change(frame.color, fetched, coverage))
            if change != 1:
                before = [before[0] * change, *before[1:]]
                if self.mixing is not None:
                    self.mixing.scale(change)
                if self.clipping is not None:
                    self.clipping.scale(change)
        about = {"still": still, "others": others}
        if self.innovation and before is not None:
            about["lag"] = lambda *old: SVGF.follow(self, frame, before, color, motion, others, *old)
            if self.repeats or not stage["clip_choice"]:
                self.clipping = None
            else:
                self.clipping = about["clip"] = self.clipping or ClipChoice()
                self.clipping.judge(frame.color, motion, yester.exposure(color))
        self.antialiased, _, _ = antialias(for_frame(stage, frame), before, color, motion, frame.depth, **about)
        shown, length = self.antialiased[:2]
        exposure = yester.exposure(color)
        shown = blacken(shown)
        if self.innovation and before is not None:
            known = {"evidence": self.rest, "motion": motion, "exposure": exposure}
            known |= {"strictness": 12, "share": 0.7}
            found, self.rest = yester.innovation(weighed(frame.color, shown, self.trust), shown, length, **known)
            self.antialiased[0] = correct(self.antialiased[0], found)
            shown = correct(shown, found)
        if stage["smooth_edges"]:
            beside = {"newest": color, "confidence": confidence, "exposure": exposure}
            shown = blacken(yester.smooth_edges(self.antialiased[0], **beside))
        if not stage["choice"]:
            return shown
        self.mixing = self.mixing or Mixing()
        about = {"exposure": exposure, "repeats": self.repeats, "aliased": frame.jitter is not None}
        return self.mixing.mix(frame.color, color, motion, blacken(self.antialiased[0]), shown, **about)

    def follow(self, frame, before, color, motion, others, old, coverage) -> NDArray:
        """History that lags, corrected by what samples show to be wrong with it along their own motion."""
        bright = yester.exposure(color)
        compared = comparable(frame, coverage, others, color, bright)
        (known, length), covered = yester.reproject(before[:2], motion, fallback=False)
        apart = ~comparable(frame, covered, others, color, bright)
        known = np.where(apart[..., None], np.float32(np.nan), known)
        asks = {"evidence": self.lag, "motion": motion, "exposure": bright, "strictness": 4, "share": 0.7}
        samples = weighed(frame.color, known, self.trust)
        found, self.lag = yester.innovation(samples, known, length, target=old, **asks)
        new = catch_up(old, color, compared, found)
        moved = np.abs(luminance(new) - luminance(old))
        steady = moved <= np.float32(0.01) * (luminance(new) + black_level(bright))
        return new, compared & ~grown(others, 2) & (steady | ~corrected_runs(found)[..., 0])

    def settle(
        self, shown: NDArray, frame: yester.Frame, motion: NDArray, *, alone: bool = False
    ) -> tuple[NDArray, NDArray | None]:
        """What is shown of a still frame, and its variance: the filtered mean of all samples, if there are enough."""
        mean, moments, number = self.still
        bright = yester.exposure(mean)
        if self.innovation and self.still_frames > 1:
            known = {"evidence": self.still_lag, "motion": motion, "exposure": bright}
            found, self.still_lag = yester.innovation(frame.color, mean, number, **known, strictness=24, share=0.7)
            mean, moments = self.still[:2] = correct_history(mean, moments, found)
        albedo, emission, normal = (self.still_guides.get(name) for name in ("albedo", "emission", "normal"))
        if albedo is None:
            return yester.converge(shown, mean, moments, number, exposure=bright), None
        texture = {"albedo": albedo, "where": reflects(frame)}
        light = yester.demodulate(mean, **texture, emission=emission)
        deviation = np.repeat(np.sqrt(variance_of_mean(moments, number))[..., None], 3, -1)
        deviation = luminance(yester.demodulate(deviation, **texture))
        guide = {"depth": frame.depth, "ids": frame.ids if normal is None else None}
        if normal is not None:
            x, y, z = np.moveaxis(normal, -1, 0)
            length = np.sqrt(x * x + y * y + z * z)[..., None]
            with np.errstate(divide="ignore", invalid="ignore"):
                guide["normal"] = np.where(length > 0, normal / length, np.float32(0))
        passes = {"iterations": self.iterations, **self.filter, **self.sigmas, "settled": self.settled}
        brighter = np.float32(16) * np.float32(yester.exposure(light))
        passes |= {"history_length": number, "relative_noise": np.inf, "tap_exposure": brighter}
        light, variance = yester.atrous(light, deviation * deviation, **guide, **passes)
        light = yester.remodulate(light, **texture, emission=emission)
        share = np.ones_like(number) if alone else np.clip((number - np.float32(8)) / np.float32(8), 0, 1)
        share = np.where(np.isfinite(light[..., 0] + light[..., 1] + light[..., 2]), share, np.float32(0))
        light = np.where(np.isfinite(light), light, np.float32(0))
        shown = shown + share[..., None] * (light - shown)
        return yester.converge(shown, mean, moments, number, exposure=bright, strictness=0.7), variance

    def choose(self, series: list, prediction, sample, motion, coverage, length, bright: float) -> tuple:
        """Select per tile from images and variances after 0, 1, 2 … passes: image, variance, and number of passes."""
        height, width = coverage.shape
        levels = np.full((height, width), self.iterations, np.float32)
        if self.choice is not None:
            asks = {"usual": self.iterations, "strictness": self.strictness}
            chosen, self.choice = yester.choice(self.choice, motion, coverage, **asks)
            filled = ~np.isfinite(series[0][0]).all(-1)
            alone = ((coverage == 0) & (length < 1.5)).astype(np.float32)
            shown = np.minimum(between_tiles(chosen, height, width) + alone, np.float32(len(series) - 1))
            levels = np.where(filled, levels, shown)
        candidates = np.dstack([prediction, *(predicted for _, _, predicted in series[1:])])
        known = {"exposure": bright, "usual": self.iterations}
        self.choice = yester.compare_candidates(sample, candidates, self.choice, **known)
        image, variance = np.zeros_like(sample), np.zeros_like(coverage)
        for passes, (each, spread, _) in enumerate(series):
            share = np.maximum(1 - np.abs(levels - np.float32(passes)), 0)
            begun = levels < passes
            mixed = np.where(begun[..., None], image, -0.0) + share[..., None] * each
            image = np.where(share[..., None] > 0, mixed, image)
            variance = np.where(share > 0, np.where(begun, variance, -0.0) + share * spread, variance)
        return image, variance, levels

    def fill(self, color: NDArray, length: NDArray, alike: dict) -> tuple[NDArray, NDArray | None]:
        """The colour that is accumulated, and its weight as a sample."""
        return color, None

    def same_surface(self, frame: yester.Frame, motion: NDArray) -> dict:
        tests = {}
        for name in ("depth", "normal", "ids", "object_normal"):
            now, before = getattr(frame, name), getattr(self.before, name)
            if now is not None and before is not None:
                before = disowned(self.before, frame) if name == "ids" else before
                tests |= {name: now, f"previous_{name}": before}
        if np.max(self.limits["motion_difference"]) < np.inf:
            tests |= told_by_motion(frame, self.before)
        if self.same_albedo and frame.albedo is not None:
            tests |= {"color": frame.albedo, "previous_color": self.before.albedo}
        if {"depth", "normal"} <= set(tests) and tells_depth(frame, motion):
            tests["previous_camera"] = self.before.camera
        return tests

    def reflect(self, frame, tests, history, confidence, light, old, sample) -> SimpleNamespace | None:
        """Replace history and confidence, in place, by those of candidates that predict better."""
        geometry = frame.depth if frame.position is None else frame.position
        known = frame.hit_distance
        if geometry is None or (known is None and frame.depth is None):
            return None
        height, width = confidence.shape
        kind = {name: value for name, value in tests.items() if name.endswith(("normal", "ids"))}
        if {"normal", "object_normal"} <= set(kind):
            kind = {name: value for name, value in kind.items() if "object" not in name}
        # Every second row is tested, for itself and the next.
        below = sample[np.minimum(np.arange(1, height + 1, 2), height - 1)]
        here, there = (np.isfinite(rows).all(-1)[..., None] for rows in (sample[::2], below))
        with np.errstate(invalid="ignore"):
            both = np.float32(0.5) * (sample[::2] + below)
        sample = np.where(here & there, both, np.where(here, sample[::2], below))
        ids = None if frame.ids is None else frame.ids[::2]
        scores, best = np.zeros_like(old), np.zeros(sample.shape[:2], np.float32)
        sure, age = np.zeros_like(best), self.mirrored.age
        tried = (age < TRIED) | ((age + TRIED * (np.arange(height) // TILE)) % PERIOD < TRIED)
        winner, motions, asked = np.full(sample.shape[:2], -1), [], []
        for k, distance in enumerate(self.distances if known is None else [None]):
            asked.append(np.broadcast_to(tried[:, None], (height, width)))
            if self.mirrored.tiles is not None:
                asked[k] = asked[k] | self.mirrored.tiles[k]
            with np.errstate(invalid="ignore"):
                hit = frame.depth * np.float32(distance) if known is None else known
            motions.append(yester.virtual_motion(geometry, hit, frame.camera, self.before.camera))
            candidate, coverage = yester.reproject(self.mirrored.light, motions[k], fallback=False, **kind)
            coverage = np.where(asked[k], coverage, 0)
            candidate = np.where((coverage > 0)[..., None], candidate, np.float32(np.nan))
            looks, averages = (candidate[::2], light[::2], sample), []
            for channel, standardized in ((k, False), (len(self.distances) + k, True)):
                gain = yester.prediction_gain(*looks, ids=ids, standardized=standardized)
                average = old[::2, :, channel] + np.float32(0.3) * (gain - old[::2, :, channel])
                averages.append(np.where(asked[k][::2], average, np.float32(0)))
                scores[..., channel] = np.repeat(averages[-1], 2, axis=0)[:height]
            gain, standardized = averages
            wins = (standardized < -0.5) & (gain < best) & (coverage > 0)[::2]
            best[wins], winner[wins], sure[wins] = gain[wins], k, standardized[wins]
        tiles, moved = [np.zeros((height, width), bool) for _ in self.distances], np.full_like(motions[0], np.nan)
        for k, motion in enumerate(motions):
            won = np.repeat(winner == k, 2, axis=0)[:height]
            moved[won] = motion[won]
            certain = np.argwhere((winner == k) & (sure < -1)) * [2, 1] // TILE
            for top, left in np.unique(certain, axis=0) * TILE:
                rows, columns = (slice(max(first - TILE, 0), first + 2 * TILE) for first in (top, left))
                tiles[k][rows, columns] = True
        values, coverage = yester.reproject(self.history, moved, fallback=False, **kind)
        carried = coverage > 0
        confidence[carried] = coverage[carried]
        for plane, value in zip(history, values, strict=True):
            plane[carried] = value[carried]
        moved[~carried] = np.nan
        self.asked.append(np.mean(asked))
        self.won.append((winner >= 0).mean())
        return SimpleNamespace(scores=scores, tiles=tiles, age=age + 1, motion=moved[..., :2])


class HalfRes(SVGF):
    def __init__(self, *, alpha=0.2, weight=0.3, radius=2, iterations=4, sigma_luminance=4.0, choice=None, **named):
        named = {"sigma_luminance": sigma_luminance, "relative_noise": 2.0, **named}
        super().__init__(alpha=alpha, iterations=iterations, radius=2, choice=choice is not False, **named)
        self.choice_with_albedo, self.strictness, self.fewest = choice is True, 1.0, np.float32(0.9)
        self.settled = 1.75
        self.weight, self.radius = np.float32(weight), radius
        self.passes, self.stage = 4, {**self.stage, "gamma": 0.6, "choice": False}

    def fill(self, color, length, alike):
        traced = np.isfinite(color).all(-1)
        weight = np.where(traced, np.float32(1), self.weight / (1 + length))
        return yester.reconstruct(color, radius=self.radius, **alike), weight


def box_sums(plane: NDArray) -> NDArray:
    """Sums over 3×3 pixels: of rows from above, then of the middle, the right and the left column."""
    padded = np.pad(plane.astype(np.float32), 1)
    columns = (padded[:-2] + padded[1:-1]) + padded[2:]
    return (columns[:, 1:-1] + columns[:, 2:]) + columns[:, :-2]


def by_light(color: NDArray, *, textured: bool) -> NDArray:
    """The weights of bright light in a fit."""
    light = luminance(color)
    seen = np.isfinite(light) & (light >= 0)
    mean = box_sums(np.where(seen, light, 0)) / np.maximum(box_sums(seen), 1)
    times = mean / (np.float32(16 if textured else 2) * np.float32(yester.exposure(color)))
    toned = 1 + (times * times if textured else times)
    return 1 / (toned * toned)


def weighed(samples: NDArray, shown: NDArray, weight: NDArray | None) -> NDArray:
    """Samples as far as their differences from what is shown count."""
    with np.errstate(invalid="ignore"):
        return samples if weight is None else shown + weight[..., None] * (samples - shown)


class BMFR:
    def __init__(
        self,
        *,
        alpha=0.05,
        fitted_alpha=0.1,
        block=None,
        by_light=True,
        features="fewest",
        restore=True,
        relative_depth=0.1,
        plane_distance=0.01,
        normal_angle=25.0,
        motion_difference=0.2,
        by_confidence=False,
        gradient=True,
        fireflies=False,
        innovation=True,
        antialias=True,
    ):
        self.alpha, self.fitted_alpha = alpha, np.float32(fitted_alpha)
        self.block, self.by_light, self.features = block, by_light, features
        self.limits = {
            "relative_depth": relative_depth,
            "plane_distance": plane_distance,
            "normal_angle": normal_angle,
            "motion_difference": motion_difference,
        }
        self.gradient, self.fireflies, self.restore = gradient, fireflies, restore
        self.innovation, self.antialias = innovation, antialias
        self.by_confidence, self.same_albedo = by_confidence, False
        self.before = self.antialiased = self.albedo = self.evidence = self.lag = self.rest = None
        self.mixing = self.clipping = self.trust = None
        self.noise, self.repeats = Noise(), False
        self.age = 0

    def step(self, frame: yester.Frame) -> SimpleNamespace:
        frame, self.before = told_apart(frame, self.before)
        shape = frame.color.shape[:2]
        sample = illumination(frame.color, frame)
        motion, still, gradient = find_motion(frame, self.before), find_still(frame, self.before), None
        self.repeats = (self.antialias or self.restore) and self.noise.repeats(sample, motion)
        if self.before is None:
            history = [np.zeros((*shape, *channels), np.float32) for channels in ((3,), (2,), (), (3,))]
            confidence, rejection = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        else:
            tests = SVGF.same_surface(self, frame, motion)
            replays = self.gradient and frame.replay is not None and self.expects_replay
            planes = [*self.history]
            if replays:
                known = frame.replay, self.before, planes[::3], planes[1]
                planes[::3], planes[1], change = relight(*known, corrects=self.innovation)
                planes.append(change)
            history, confidence = yester.reproject(planes, motion, **tests, **self.limits)
            rejection, _ = yester.consistency(motion, **tests, **self.limits)
            if self.innovation and not replays:
                history, self.history = follow_light(sample, history, confidence, self.history)
        fresh = sample
        if self.fireflies:
            alike = {name: getattr(frame, name) for name in ("depth", "normal", "ids")}
            sample = without_fireflies(frame, sample, history[0], alike)
        if self.before is not None:
            if replays:
                gradient = history[4]
            elif self.gradient:
                known = np.where((confidence > 0)[..., None], history[0], np.float32(np.nan))
                gradient = yester.temporal_gradient(sample, known, noise=2.2, widest=5)
        trust = confidence if self.by_confidence else None
        merged = yester.accumulate(sample, *history[:3], gradient=gradient, confidence=trust, alpha=self.alpha)
        color, moments, length = merged.color, merged.moments, merged.history_length
        geometry = frame.depth if frame.position is None else frame.position
        if frame.position is None and frame.camera is None:
            geometry = None
        self.trust = by_light(color, textured=frame.albedo is not None) if self.by_light else None
        weight = self.trust
        if frame.albedo is not None:
            first, second = moments[..., 0], moments[..., 1]
            shines = ~(second - first * first > np.float32(0.01) * (first * first))
            if frame.emission is not None:
                shines |= (frame.emission > 0).any(-1)
            shines &= (frame.albedo <= 1 / 1024).all(-1)
            magnified = luminance(yester.demodulate(np.ones_like(color), **texture_of(frame)))
            dark = np.maximum(np.float32(0.15) * magnified, 1)
            weight = (np.float32(1) if weight is None else weight) * (1 / (dark * dark))
            weight = np.where(shines, np.float32(np.nan), weight)
        block = self.block or (8 if frame.albedo is None else 16)
        fitted, _ = yester.regress(
            color,
            normal=frame.normal,
            geometry=geometry,
            camera=frame.camera,
            weight=weight,
            block=block,
            offset=tuple((OFFSETS[self.age % 8] * block // 8).tolist()),
            features=self.features,
        )
        with np.errstate(divide="ignore", over="ignore"):
            share = np.minimum(np.maximum(1 / length, self.fitted_alpha), 1)
        fits = light = yester.blend(fitted, history[3], share)
        if self.restore and not self.repeats:
            clipped = yester.clip_history(color, fresh, box="minmax", space="rgb", response="clamp")
            with np.errstate(divide="ignore", invalid="ignore"):
                variance = np.maximum(moments[..., 1] - moments[..., 0] * moments[..., 0], 0) / length
            variance = np.where(length >= 3.5, variance, np.float32(np.nan))
            if self.trust is not None:
                bound = np.where(fresh > fits, fresh, fits)
                with np.errstate(invalid="ignore"):
                    toned = 1 + (1 / np.sqrt(self.trust[..., None]) - 1) / 8
                    held = bound + (clipped - bound) / (toned * toned)
                clipped = np.where((clipped > bound) & np.isfinite(held), held, clipped)
            light = yester.restore_detail(fits, clipped, variance, strictness=0.7)
        if self.innovation and self.before is not None:
            known = {"evidence": self.evidence, "motion": motion, "exposure": yester.exposure(color)}
            found, self.evidence = yester.innovation(weighed(fresh, light, self.trust), light, length, **known)
            light, fits = correct(light, found), correct(fits, found)
            color, moments = correct_history(color, moments, found, length)
        self.expects_replay = self.before is None or frame.replay is not None
        self.history, self.before = [color, moments, length, fits], frame
        self.age += 1
        if frame.albedo is not None:
            light = yester.remodulate(light, **texture_of(frame), emission=frame.emission)
        if self.antialias:
            light = SVGF.finish(self, PRESETS["denoised"], light, frame, motion, still, confidence)
        return SimpleNamespace(
            color=blacken(light),
            history_length=length,
            confidence=confidence,
            rejection=rejection,
            missing=merged.missing,
        )


class Recirculation:
    BEST = {"factor": 2, "levels": None, "nearness": 0, "history": "splat", "innovation": True}  # noqa: RUF012
    BEST |= {"fireflies": False, "blur": 0.25, "share": (0.0, 1.0), "fade": 64.0, "limit": 8.0, "tolerance": 0.1}
    TEXTBOOK = {"factor": 4, "levels": 2, "nearness": 1, "history": "fetch", "share": (0.1, 0.5)}  # noqa: RUF012
    TEXTBOOK |= {"innovation": False}

    def __init__(self, preset="best", **given):
        params = self.BEST | (self.TEXTBOOK if preset == "textbook" else {}) | given
        self.pyramid = {name: params[name] for name in ("factor", "levels")}
        self.blend = {name: params[name] for name in ("share", "fade", "limit")}
        self.blur, self.tolerance = params["blur"], np.float32(params["tolerance"])
        self.nearness, self.fetches = params["nearness"], params["history"] == "fetch"
        self.corrects, self.fireflies = params["innovation"], params["fireflies"]
        self.points = self.camera = self.evidence = None

    def weight(self, inverse: np.ndarray) -> np.ndarray:
        power = np.ones_like(inverse)
        for _ in range(self.nearness):
            power = power * inverse
        return np.maximum(power, np.float32(1e-24))

    def fetched(self, filled, fresh, frame) -> tuple:
        """Colour, quality, confidence and motion, fetched from the last output."""
        height, width = fresh.shape
        before = self.camera or frame.camera
        nothing = np.zeros_like(frame.color), np.zeros_like(fresh)
        old, known = self.points or nothing
        with np.errstate(divide="ignore"):
            motion = yester.motion_vectors(1 / filled[..., 3], frame.camera, before) + filled[..., 4:]
        images = filled[..., :3], fresh, old, known, motion
        shown, quality = yester.recirculate(*images, blur=self.blur, fetch=True, **self.blend)
        inside, (x, y) = np.isfinite(motion[..., :2]).all(-1), np.indices((width, height)).transpose(0, 2, 1)
        step = np.where(inside[..., None], motion[..., :2], np.float32(0))
        x, y = (np.floor(np.float32(at) + np.float32(0.5) + step[..., c]) for c, at in enumerate((x, y)))
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        found = inside & (known[y.clip(0, height - 1).astype(int), x.clip(0, width - 1).astype(int)] > 0)
        return shown, quality, found, motion

    def correct(self, frame, traced, shown, quality, motion) -> NDArray:
        """The correction to be added; keeps the evidence."""
        if not self.corrects or self.points is None:
            return np.zeros_like(shown)
        fresh = np.where(traced[..., None], frame.color, np.float32(np.nan))
        known = {"evidence": self.evidence, "motion": motion, "exposure": yester.exposure(shown)}
        found, self.evidence = yester.innovation(fresh, shown, quality, **known, sparse=True)
        return found

    def step(self, frame: yester.Frame) -> SimpleNamespace:
        frame = hold_down(frame, None) if self.fireflies else frame
        height, width = frame.shape
        centres = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
        if frame.position is not None:
            hit = np.isfinite(frame.position).all(-1)
            pixels, depth = frame.camera.project(np.where(hit[..., None], frame.position, 0))
            depth = np.where(hit, depth, np.inf).astype(np.float32)
            own = np.where(hit[..., None], pixels - centres, frame.jitter or (0, 0)).astype(np.float32)
        else:
            depth, own = frame.depth, np.broadcast_to(np.float32(frame.jitter or (0, 0)), (height, width, 2))
        traced = np.isfinite(frame.color).all(-1) & (depth > 0)
        own = own.clip(-0.5, 0.5)
        drift = np.zeros_like(frame.color)
        if frame.motion is not None and self.points is not None:
            geometry = frame.depth if frame.position is None else frame.position
            channels = frame.motion.shape[-1]
            still = yester.motion_vectors(geometry, frame.camera, self.camera)
            with np.errstate(invalid="ignore"):
                drift[..., :channels] = frame.motion - still[..., :channels]
            drift = np.where(np.isfinite(drift), drift, np.float32(0))

        with np.errstate(divide="ignore", invalid="ignore"):
            samples = np.where(traced[..., None], np.dstack([frame.color, 1 / depth, drift]), np.float32(np.nan))
            weights = self.weight(samples[..., 3]) if self.nearness else None
            filled, fresh = yester.pull_push(samples, weights, **self.pyramid)
            if self.nearness:
                fresh = np.where(fresh > 0, fresh / self.weight(filled[..., 3]), np.float32(0))
        if self.fetches:
            shown, quality, kept, motion = self.fetched(filled, fresh, frame)
            shown = correct(shown, self.correct(frame, traced, shown, quality, motion))
            rejection = (~kept if self.points else np.zeros_like(kept)).astype(np.uint8)
            self.points, self.camera = (shown, quality), frame.camera
            return SimpleNamespace(
                color=blacken(shown),
                history_length=quality,
                confidence=kept.astype(np.float32),
                rejection=rejection,
                missing=int((~traced).sum()),
            )

        if self.points is None:
            color, place, quality = (
                np.zeros((height, width, 6), np.float32),
                np.zeros((height, width)),
                np.zeros((height, width)),
            )
            offset, camera = np.zeros((height, width, 2), np.float32), frame.camera
            place, quality = place.astype(np.float32), quality.astype(np.float32)
        else:
            camera = self.camera
            given = dict(zip(("color", "drift", "depth", "offset", "quality"), self.points, strict=True))
            given["color"] = np.dstack([given["color"], given["drift"]])
            cameras = {"camera": frame.camera, "previous_camera": camera, "tolerance": self.tolerance, "reach": 0.5}
            color, place, offset, quality = yester.splat(**given, **cameras)

        with np.errstate(divide="ignore", invalid="ignore"):
            known = quality > 0
            gone = known & traced & ~((np.abs(place - depth) <= self.tolerance * depth) | (place == depth))
            quality = np.where(gone, np.float32(0), quality)
            kept = quality > 0
            fresh = np.where(~traced & (quality > 8 * fresh), np.float32(0), fresh)
            share = np.where(kept, fresh / (fresh + quality), np.float32(1))

            def joined(old, new, share):
                met = np.where(kept.reshape(share.shape) & (old != new), old + share * (new - old), new)
                return np.where(
                    traced.reshape(share.shape), met, np.where(kept.reshape(share.shape), old, np.float32(0))
                )

            place = np.where(traced | kept, joined(place, depth, share), 1 / filled[..., 3])
            offset = joined(offset, own, share[..., None])
        drift = np.where((kept & ~traced)[..., None], color[..., 3:], filled[..., 4:])
        motion = yester.motion_vectors(place, frame.camera, camera) + drift
        images = filled[..., :3], fresh, color[..., :3], quality, motion
        carried, quality = yester.recirculate(*images, blur=0, **self.blend)
        shown, _ = yester.recirculate(*images, blur=self.blur, **self.blend)
        found = self.correct(frame, traced, shown, quality, motion)
        shown, carried = correct(shown, found), correct(carried, found)
        rejection = np.where(known, 2 * gone, 0 if self.points is None else 1).astype(np.uint8)
        self.points, self.camera = (carried, drift, place, offset, quality), frame.camera
        return SimpleNamespace(
            color=blacken(shown),
            history_length=quality,
            confidence=kept.astype(np.float32),
            rejection=rejection,
            missing=int((~traced).sum()),
        )


class Upscaler:
    def __init__(
        self,
        scale=2.0,
        *,
        alpha=0.06,
        fast_alpha=0.5,
        speed=(0.0, 1.0),
        separation=0.05,
        lifetime=16.0,
        sharpness=0.0,
        fireflies=False,
        noise=2.2,
        change=4.0,
    ):
        self.scale, self.pace, self.speed = scale, {"alpha": alpha, "fast_alpha": fast_alpha, "speed": speed}, speed
        self.separation, self.lifetime, self.sharpness = separation, np.float32(lifetime), sharpness
        self.fireflies, self.noise, self.change = fireflies, noise, np.float32(change)
        self.history = self.before = None

    def step(self, frame: yester.Frame) -> SimpleNamespace:
        small, one = frame.color.shape[:2], np.float32(1)
        large = tuple(round(side * self.scale) for side in small)
        jitter = np.array(frame.jitter or (0.0, 0.0))

        def enlarge(image):
            return yester.resample(image, large, offset=jitter, filter="nearest")[0]

        motion = find_motion(frame, self.before)
        choose = "longest" if frame.depth is None else "nearest"
        moved = enlarge(yester.dilate_motion(motion, frame.depth, choose=choose, margin=0.1)[..., :2].copy())
        moved *= (np.float32(large[::-1]) / np.float32(small[::-1])).astype(np.float32)
        hidden = np.zeros(large, np.float32)
        if frame.depth is not None:
            hidden = enlarge(yester.disocclusion(frame.depth, motion, separation=self.separation))
        if self.history is None:
            history, samples = np.zeros((*large, 3), np.float32), np.zeros(large, np.float32)
            lock, coverage, rejection = samples, samples, np.zeros(large, np.uint8)
        else:
            fetched, coverage = yester.reproject(self.history, moved, filter="catmull-rom-5", fallback=False)
            history, samples, lock = fetched
            rejection, _ = yester.consistency(moved)
        across = -jitter * large[::-1] / small[::-1]  # to the samples, in pixels of the history
        there, _ = yester.resample(history, small, offset=across, filter="nearest")
        if self.fireflies:
            frame = hold_down(frame, there)
        thin = enlarge(yester.thin_features(frame.color))
        color, weight = yester.resample(frame.color, large, offset=jitter)
        bright = yester.exposure(frame.color)
        change, around = (
            enlarge(yester.temporal_gradient(frame.color, there, noise=self.noise, passes=passes, widest=passes))
            for passes in (1, 3)
        )
        box = {"box": "variance", "space": "tonemapped-ycocg", "response": "clamp"}
        clipped = yester.clip_history(history, color, exposure=bright, **box)

        reacts = np.zeros(large, np.float32) if frame.reactive is None else np.nan_to_num(enlarge(frame.reactive))
        confidence = coverage * (one - hidden) * (one - np.clip(reacts, 0, 1))
        haste = yester.blend_factor(np.ones_like(samples), moved, alpha=0.0, fast_alpha=1.0, speed=self.speed)
        same = one - np.minimum(self.change * change, one)
        lock = lock * (one - np.clip(self.change * around - one, 0, 1))
        hold = np.maximum(same * (one - haste), lock)
        held = yester.blend(history, clipped, hold)
        share = yester.blend_factor(confidence, moved, **self.pace)
        new = np.where(np.isfinite(color).all(-1), weight, np.float32(0))
        with np.errstate(divide="ignore", invalid="ignore"):
            samples = np.minimum(samples, one / share - one)
            share = np.where(samples > 0, new / (samples + new), one)
        lock = np.maximum(lock * confidence - one / self.lifetime, thin * np.minimum(weight, one))
        self.history = [yester.blend(color, held, share), samples + new, lock]
        self.before = frame
        return SimpleNamespace(
            color=yester.sharpen(self.history[0], strength=self.sharpness, exposure=bright),
            history_length=samples + new,
            confidence=confidence,
            rejection=rejection | np.where(hidden > 0, np.uint8(yester.Rejection.DEPTH), np.uint8(0)),
            missing=int((~np.isfinite(frame.color).all(-1)).sum()),
        )
