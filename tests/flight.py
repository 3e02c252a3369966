"""The sequence that most tests render: a camera flies past a box and two balls, one of which travels and turns."""

from dataclasses import replace

import numpy as np
import yester
from numpy.typing import NDArray
from yester.study.synthetic import raycast
from yester.study.synthetic.raycast import Box, Light, Rectangle, Scene, Sphere, Thing, translate, turn

#: Ids: positions in the list of things.
GROUND, BOX, BALL, MOVER = 1, 2, 3, 4
SUN = Light((0.4, 0.8, 0.45), (1.0, 1.0, 1.0), distant=True)


def camera(number: float, width: int, height: int) -> yester.Camera:
    origin, target = [0.08 * number, 1.5 + 0.02 * number, 4.0 - 0.05 * number], [0.02 * number, 0.5, 0]
    return yester.Camera.from_look_at(origin, target, [0, 1, 0], 55, width, height)


def mover(number: float) -> NDArray[np.float64]:
    """Object to world of the moving ball."""
    place = translate(-0.6 + 0.12 * number, 0.45 + 0.03 * number, 0.6 + 0.06 * number)
    return place @ turn([0, 1, 0], np.degrees(0.1 * number))


def transforms(number: float) -> dict[int, NDArray[np.float64]]:
    """Of the moving ball's points, from this frame to the previous one."""
    return {MOVER: mover(number - 1) @ np.linalg.inv(mover(number))}


def scene(number: float, camera: yester.Camera) -> Scene:
    """The things of frame `number`, seen by any camera."""
    things = (
        # Ends 60 units ahead of the first camera, so that there is background.
        Thing(Rectangle(240, 112), turn([1, 0, 0], -90), (0.7, 0.6, 0.5), shadow=False),
        Thing(Box((1.0, 1.1, 0.9)), translate(-1.1, 0.55, -0.75), (0.2, 0.5, 0.8), shadow=False),
        Thing(Sphere(0.6), translate(0.9, 0.6, -0.4), (0.9, 0.3, 0.2), shadow=False),
        Thing(Sphere(0.4), mover(number), (0.3, 0.8, 0.3), shadow=False),
    )
    return Scene(things, camera, (SUN,))


def sample(scene: Scene, before: Scene | None = None, offset: tuple[float, float] = (0.0, 0.0)) -> yester.Frame:
    """A frame without noise, cast at an offset from the pixel centres; with motion if there is a scene before it."""
    frame = raycast.shoot(scene, before, np.random.default_rng(0), jitter=offset)
    left_out = {"emission": None, "object_normal": None, "jitter": None}
    return replace(frame, **left_out | ({} if before else {"motion": None}))


def shoot(number: float, width: int, height: int, *, moving: bool = True) -> yester.Frame:
    """Frame `number` without noise, with exact motion; or all of it at rest, without motion."""
    if not moving:
        return sample(scene(0, camera(0, width, height)))
    now, before = (scene(n, camera(n, width, height)) for n in (number, number - 1))
    return sample(now, before)


def noisy(frame: yester.Frame, rng: np.random.Generator) -> NDArray[np.float32]:
    """Its colour as from one sample per pixel: times exponential noise of mean one."""
    return frame.color * raycast.noise(rng, (*frame.shape, 1), 1.0)
