"""One valid call of every array function: varied by the tests of inputs, bits and threads."""

from collections.abc import Callable

import compare
import numpy as np
import yester


def calls(height: int = 6, width: int = 9, seed: int = 0) -> dict[str, tuple[Callable, dict]]:
    """name -> (function, its arguments by name), every optional buffer given."""
    rng = np.random.default_rng(seed)
    now = compare.surfaces(rng, height, width)
    before = compare.previous(rng, now, turn=0.1)
    camera, previous_camera = (compare.camera(rng, width, height) for _ in range(2))
    color, history = (compare.colors(rng, height, width) for _ in range(2))
    length = rng.integers(0, 9, (height, width)).astype(np.float32)
    light = np.nan_to_num(color[..., 1], nan=1, posinf=1, neginf=1)
    moments = np.stack([light, light**2 * 1.5], -1)
    motion = compare.motions(rng, height, width, 3)
    turned = {"object_normal": now["normal"], "previous_object_normal": before["previous_normal"]}
    lit = {"color": color, "previous_color": history, "relative_luminance": (0.2, 0.9), "speed": (1, 9)}
    tests = {**now, **before, **turned, "previous_camera": previous_camera}
    low = {f"low_{name}": image[::2, ::2].copy() for name, image in now.items()}
    albedo = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    memory = rng.normal(0, 0.3, (height, width, 7)).astype(np.float32)
    emission = rng.exponential(0.1, (height, width, 3)).astype(np.float32)
    position = rng.normal(0, 2, (height, width, 3)).astype(np.float32) - np.float32([0, 0, 8])
    cameras = {"camera": camera, "previous_camera": previous_camera}
    evidence = rng.normal(0, 0.3, ((height + 1) // 2, (width + 1) // 2, 4)).astype(np.float32)
    evidence[..., 3] = rng.uniform(0, 1, evidence.shape[:2])
    candidates = rng.exponential(1, (height, width, 3)).astype(np.float32)
    gains = rng.normal(0, 20, ((height + 7) // 8, (width + 7) // 8, 6)).astype(np.float32)
    gains[..., 2:] = np.abs(gains[..., 2:]) + 9
    more = np.random.default_rng(seed)
    planes = light[..., None] + more.normal(0, 0.3, (height, width, 5)).astype(np.float32)
    products = np.abs(more.normal(0, 20, (*gains.shape[:2], 14))).astype(np.float32) + np.float32(9)
    deviation = more.uniform(-1, 1, ((height + 7) // 8 * 2, width)).astype(np.float32)
    moved = {"ids": now["ids"], "transforms": {1: np.diag([1.0, 2, 1, 1])}}
    return {
        "motion_vectors(depth)": (yester.motion_vectors, {"geometry": now["depth"], **cameras, **moved}),
        "motion_vectors(position)": (yester.motion_vectors, {"geometry": position, **cameras, **moved}),
        "virtual_motion": (
            yester.virtual_motion,
            {"geometry": position, "hit_distance": np.abs(light) * 3, **cameras},
        ),
        "depth_change": (
            yester.depth_change,
            {"depth": now["depth"], "previous_depth": now["depth"] * 1.2, "motion": motion},
        ),
        "dilate_motion": (yester.dilate_motion, {"motion": motion, "depth": now["depth"]}),
        "invert_motion": (
            yester.invert_motion,
            {"motion": motion, "depth": now["depth"], "still": np.negative(motion)},
        ),
        "disocclusion": (yester.disocclusion, {"depth": now["depth"], "motion": motion}),
        "reproject": (yester.reproject, {"history": history, "motion": motion, **tests}),
        "reproject(nearest)": (yester.reproject, {"history": length, "motion": motion, "filter": "nearest"}),
        "reproject(catmull-rom)": (
            yester.reproject,
            {"history": history, "motion": motion, "filter": "catmull-rom", **tests},
        ),
        "consistency": (yester.consistency, {"motion": motion, **tests}),
        "consistency(soft)": (yester.consistency, {"motion": motion, **tests, **lit, "normal_angle": (10, 40)}),
        "consistency(motion)": (yester.consistency, {"motion": motion, "previous_motion": np.roll(motion, 3, 1)}),
        "blend_factor": (yester.blend_factor, {"confidence": length / 9, "motion": motion}),
        "clip_history": (yester.clip_history, {"history": history, "color": color}),
        "clip_history(hull)": (
            yester.clip_history,
            {"history": history, "color": color, "box": "hull", "response": "current"},
        ),
        "clip_history(exact-hull)": (
            yester.clip_history,
            {"history": history, "color": color, "box": "exact-hull", "response": "current"},
        ),
        "clip_history(chroma-hull)": (
            yester.clip_history,
            {"history": history, "color": color, "box": "chroma-hull", "response": "current"},
        ),
        "exposure": (yester.exposure, {"color": color}),
        "light_change": (yester.light_change, {"color": 0.5 * color, "history": color, "coverage": length / 9 + 0.5}),
        "repetition": (
            yester.repetition,
            {"color": color, "previous": history, "motion": motion, "deviation": deviation},
        ),
        "material_change": (
            yester.material_change,
            {"albedo": albedo, "previous_albedo": albedo[::-1].copy(), "motion": motion, "share": 0.3, "radius": 2},
        ),
        "alternation": (yester.alternation, {"color": color, "memory": memory}),
        "anti_lag": (yester.anti_lag, {"history_length": length, "history": history, "clipped": color}),
        "temporal_gradient": (yester.temporal_gradient, {"color": color, "previous": history}),
        "innovation": (
            yester.innovation,
            {
                **{"color": color, "prediction": history, "history_length": length, "evidence": evidence},
                **{"motion": motion, "target": color},
            },
        ),
        "choice": (
            yester.choice,
            {"evidence": gains, "motion": motion, "coverage": length, "usual": 1},
        ),
        "compare_candidates": (
            yester.compare_candidates,
            {"color": color, "candidates": candidates, "evidence": gains, "usual": 1},
        ),
        "collocate": (yester.collocate, {"planes": planes, "evidence": products}),
        "collocation_shares": (
            yester.collocation_shares,
            {"evidence": products, "motion": motion, "coverage": length},
        ),
        "prediction_gain": (
            yester.prediction_gain,
            {
                "candidate": history,
                "base": color[::-1].copy(),
                "color": color,
                "ids": now["ids"],
                "standardized": True,
            },
        ),
        "blend": (yester.blend, {"color": color, "history": history, "alpha": length / 9, "flicker": 0.5}),
        "accumulate": (
            yester.accumulate,
            {"color": color, "history": history, "history_moments": moments, "history_length": length},
        ),
        "accumulate(gradient)": (
            yester.accumulate,
            {
                "color": color,
                "history": history,
                "history_moments": moments,
                "history_length": length,
                "gradient": length / 9,
                "weight": length[::-1].copy() / 9,
            },
        ),
        "combine_histories": (
            yester.combine_histories,
            {
                "color": color,
                "moments": moments,
                "history_length": length,
                "other_color": history,
                "other_moments": moments[::-1].copy(),
                "other_length": length[:, ::-1].copy(),
                "gradient": length / 20,
            },
        ),
        "converge": (
            yester.converge,
            {"color": color, "mean": history, "moments": moments, "history_length": length},
        ),
        "resolve": (yester.resolve, {"samples": [color, history], "offsets": yester.jitter(2).tolist()}),
        "resample": (
            yester.resample,
            {"image": color, "size": (2 * height, round(1.5 * width)), "offset": (0.3, -0.2)},
        ),
        "thin_features": (yester.thin_features, {"color": color}),
        "sharpen": (yester.sharpen, {"color": color}),
        "smooth_edges": (yester.smooth_edges, {"color": history}),
        "smooth_edges(newest)": (
            yester.smooth_edges,
            {"color": history, "newest": color, "confidence": length[::-1].copy() / 9},
        ),
        "estimate_variance": (
            yester.estimate_variance,
            {"moments": moments, "history_length": length, **now},
        ),
        "atrous": (yester.atrous, {"color": color, "variance": light**2, **now}),
        "atrous(slopes)": (yester.atrous, {"color": color, "variance": light**2, **now}),
        "atrous(prediction)": (
            yester.atrous,
            {"color": color, "variance": light**2, "prediction": history[..., 1].copy(), **now},
        ),
        "atrous(history_length)": (
            yester.atrous,
            {"color": color, "variance": light**2, "history_length": length, "tap_exposure": 0.5},
        ),
        "regress": (
            yester.regress,
            {"color": color, "normal": now["normal"], "geometry": position, "weight": length, "offset": (3, -2)},
        ),
        "regress(depth)": (
            yester.regress,
            {"color": color, "geometry": now["depth"], "camera": camera, "block": 8, "features": "all"},
        ),
        "restore_detail": (
            yester.restore_detail,
            {"smooth": history, "noisy": color, "variance": light**2 / 4},
        ),
        "suppress_fireflies": (yester.suppress_fireflies, {"color": color, "expected": history, **now}),
        "fix_history": (yester.fix_history, {"color": color, "history_length": length, **now}),
        "reconstruct": (yester.reconstruct, {"color": color, **now}),
        "joint_bilateral_upsample": (
            yester.joint_bilateral_upsample,
            {"color": color[::2, ::2].copy(), **now, **low},
        ),
        "incoherent_guides": (
            yester.incoherent_guides,
            {"normal": now["normal"], "ids": now["ids"], "confidence": length / 9},
        ),
        "is_reflectance": (yester.is_reflectance, {"albedo": albedo, "ids": now["ids"]}),
        "material_ids": (
            yester.material_ids,
            {"albedo": albedo * np.float32(1.6), "normal": now["normal"], "depth": now["depth"]},
        ),
        "demodulate": (yester.demodulate, {"color": color, "albedo": albedo, "emission": emission}),
        "demodulate(where)": (
            yester.demodulate,
            {"color": color, "albedo": albedo, "where": now["ids"] % 2 == 0},
        ),
        "remodulate": (yester.remodulate, {"illumination": color, "albedo": albedo, "emission": emission}),
        "splat": (
            yester.splat,
            {
                "color": color,
                "depth": now["depth"],
                **cameras,
                "offset": rng.uniform(-0.5, 0.5, (height, width, 2)).astype(np.float32),
                "drift": np.where(rng.random((height, width, 1)) < 0.8, np.float32(0), motion),
                "quality": 1 + length,
            },
        ),
        "pull_push": (yester.pull_push, {"color": color, "quality": length}),
        "recirculate": (
            yester.recirculate,
            {
                "filled": color,
                "filled_quality": 1 + length,
                "reprojected": history,
                "reprojected_quality": length,
                "motion": motion,
            },
        ),
        "morphological_aa": (yester.morphological_aa, {"color": color}),
    }


def arrays(result) -> list[np.ndarray]:
    """All arrays of a result, in order; a number counts as an array."""
    if isinstance(result, float):
        result = np.array(result, np.float32)
    if isinstance(result, yester.Accumulated):
        result = [result.color, result.moments, result.history_length]
    if isinstance(result, np.ndarray):
        return [result]
    return [array for part in result for array in arrays(part)] if isinstance(result, list | tuple) else []
