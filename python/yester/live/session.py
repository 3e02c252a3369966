"""The world that viewers look at: rendered in one thread while another denoises the frame before.

The threads are coupled so that nothing queues up: a frame is handed over only when the one before it is denoised, and
rendering takes the newest state. A picture is thus at most one frame behind the renderer.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Condition, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import OIDN, TAA, Frame, Output, __version__
from . import controls, views
from .messages import Message, packed
from .recording import Recorder
from .samples import Samples
from .scene import Pose, Shot, World, flown
from .sizes import Adaptation
from .views import VIEWS, Moment

__all__ = ["RATE", "SAMPLES", "Session", "Viewer"]

#: Frames a second that the resolution is adapted to.
RATE = 10
#: Samples of a pixel after which a picture at rest is taken for the reference, and nothing more is rendered.
SAMPLES = 1024
#: Samples from which a picture counts as resting, and keeps its size.
_REST = 10
#: Pipelines of single views, which run only while a viewer looks at one.
_EXTRAS: dict[str, Callable[[], Any]] = {"antialiased": TAA, "oidn": lambda: OIDN("fast")}


@dataclass(eq=False)
class Viewer:
    """Somebody who looks: what at, and where messages go.

    Attributes
    ----------
    send : callable
        Takes a message for the page: a dict, or the bytes of a picture. It is called in any thread and must not wait.
    views : tuple of str
        Left and right view.
    exposure : float
        In stops.
    input : int
        Number of the newest change of the camera, which comes back with the first picture that shows it.
    """

    send: Callable[[Message], None]
    views: tuple[str, str] = ("raw", "denoised")
    exposure: float = 0.0
    input: int = 0


@dataclass(frozen=True)
class _State:
    """Everything that a frame depends on."""

    pose: Pose
    light: bool = True
    moving: bool = True
    pipeline: str = "SVGF"
    parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Rendered:
    """A frame on its way to the denoiser."""

    number: int
    frame: Frame
    shot: Shot
    state: _State
    inputs: dict[Viewer, int]
    cut: bool
    seed: int
    idle: bool
    ms: float = 0.0


class Session:
    """A world with its viewers: renders while somebody looks and something changes, or the picture is not yet clean.

    Parameters
    ----------
    world : World
    adapt : bool, default True
        Adapt the resolution to `RATE`; otherwise it is that of the world.
    folder : path-like, default "."
        Where recordings go.
    """

    def __init__(self, world: World, *, adapt: bool = True, folder: Path | str = ".") -> None:
        self.world = world
        self.sizes = Adaptation(world.size, RATE, adapt=adapt)
        self.folder = Path(folder)
        self._wake = Condition()
        self._viewers: dict[Viewer, None] = {}
        self._state = _State(world.home, moving=world.flies)
        self._frozen = self._closed = self._painting = False
        self._steps = self._number = 0
        self._flown = 0.0
        self._cut = True
        self._cuts = 0
        self._change = 0  # counts what makes a frame differ from the one before
        self._rendered_change = -1
        self._recorder: Recorder | None = None
        self._recorded = ""
        self._pipeline: Any = None
        self._made: tuple[str, dict[str, Any]] | None = None
        self._extras: dict[str, Any] = {}  # None for those that are not installed
        self._last: tuple[_Rendered, Moment] | None = None
        self._samples = Samples()
        self._times = {"render": 0.0, "denoise": 0.0, "views": 0.0, "period": 0.0}
        self._shown_at = 0.0
        self._denoiser = ThreadPoolExecutor(1, "yester-denoise")
        self._renderer = Thread(target=self._run, name="yester-render", daemon=True)
        self._renderer.start()

    def join(self, viewer: Viewer) -> None:
        """Add a viewer, who is told what there is, and shown the newest picture."""
        viewer.send(self._about())
        with self._wake:
            self._viewers[viewer] = None
            self._wake.notify_all()
        self._repaint()

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer; without viewers, nothing is rendered."""
        with self._wake:
            self._viewers.pop(viewer, None)

    def close(self) -> None:
        """Stop the threads, and complete a recording."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        self._renderer.join()
        self._denoiser.shutdown()
        self._record(False)

    def tell(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        """Do what a viewer's page asks for.

        Parameters
        ----------
        viewer : Viewer
        message : mapping of str to value
            Any of ``pose`` (with ``eye`` and ``target``) and ``input``; ``views``; ``exposure``; ``pipeline`` and
            ``parameters``; ``light``, ``moving``, ``freeze``, ``record`` (booleans); ``step``, ``cut``, ``home``;
            ``size``, an index of `sizes`, or None to adapt it.

        Raises
        ------
        ValueError
            If the message has another entry, or one has a value that it cannot have; this entry then changes nothing.
        """
        known = {name.removeprefix("_set_") for name in dir(self) if name.startswith("_set_")} | {"input", "parameters"}
        for name in message:
            if name not in known:
                raise ValueError(f"message: expected some of {', '.join(sorted(known))}, got {name!r}")
        for name in message:
            if hasattr(self, f"_set_{name}"):
                getattr(self, f"_set_{name}")(viewer, message)

    def _set_pose(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        try:
            eye, target = ([float(x) for x in message["pose"][name]] for name in ("eye", "target"))
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"pose: expected eye and target, got {message['pose']!r:.80}") from error
        pose = Pose(tuple(eye), tuple(target), self.world.home.up)
        number = message.get("input", 0)
        if not isinstance(number, int):
            raise ValueError(f"input: expected a whole number, got {number!r}")
        with self._wake:
            viewer.input = number
            self._update(pose=pose)

    def _set_home(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        self._update(pose=self.world.home)

    def _set_light(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        self._update(light=_boolean(message, "light"))

    def _set_moving(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        self._update(moving=_boolean(message, "moving") and self.world.flies)

    def _set_pipeline(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        parameters = message.get("parameters", {})
        if not isinstance(parameters, dict):
            raise ValueError(f"parameters: expected a mapping, got {parameters!r}")
        controls.build(message["pipeline"], parameters)
        self._update(pipeline=message["pipeline"], parameters=parameters)

    def _set_views(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        given = message["views"]
        if not isinstance(given, list) or len(given) != 2 or not all(one in [*VIEWS] for one in given):
            raise ValueError(f"views: expected two of {', '.join(VIEWS)}, got {given!r}")
        viewer.views = (given[0], given[1])
        self._repaint()

    def _set_exposure(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        value = message["exposure"]
        if not isinstance(value, int | float) or not -20 <= value <= 20:
            raise ValueError(f"exposure: expected -20 to 20 stops, got {value!r}")
        viewer.exposure = float(value)
        self._repaint()

    def _set_freeze(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        with self._wake:
            self._frozen = _boolean(message, "freeze")
            self._wake.notify_all()
        self._repaint()

    def _set_step(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        with self._wake:
            self._frozen = True
            self._steps += 1
            self._wake.notify_all()

    def _set_cut(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        with self._wake:
            self._cut = True
            self._changed()

    def _set_size(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        index = message["size"]
        if index is not None and (not isinstance(index, int) or not 0 <= index < len(self.sizes.all)):
            raise ValueError(f"size: expected 0 to {len(self.sizes.all) - 1}, or None, got {index!r}")
        with self._wake:
            if self._recorder is not None:
                raise ValueError("size: expected the same as long as frames are recorded")
            self.sizes.fix(index)
            self._changed()

    def _set_record(self, viewer: Viewer, message: Mapping[str, Any]) -> None:
        on = _boolean(message, "record")
        self._later(self._record, on)
        self._repaint()

    def _later(self, work: Callable[..., None], *arguments: Any) -> None:
        """Hand something to the thread that denoises, unless the session is closed; viewers are told of errors."""
        with self._wake:
            if self._closed:
                return
            handed = self._denoiser.submit(work, *arguments)

        def told(done: Future[None]) -> None:
            if not done.cancelled() and (error := done.exception()) is not None:
                self._broadcast({"error": f"{type(error).__name__}: {error}"})

        handed.add_done_callback(told)

    def _update(self, **changes: Any) -> None:
        with self._wake:
            state = replace(self._state, **changes)
            if state != self._state:
                self._state = state
                self._changed()
                if self._frozen:  # the buttons show what comes next
                    self._repaint()

    def _changed(self) -> None:
        self._change += 1
        self._wake.notify_all()

    def _due(self) -> bool:
        """Whether a frame is to be rendered; called with the lock."""
        if self._closed or self._steps:
            return True
        if self._frozen or not self._viewers:
            return False
        new = self._change != self._rendered_change
        return new or self._state.moving or self._recorder is not None or self._samples.count < SAMPLES

    def _run(self) -> None:
        """Render frames and hand them over, in a thread of its own: Mitsuba's."""
        handed: Future[None] | None = None
        before = time.perf_counter()
        while True:
            with self._wake:
                idle = not self._due()
                self._wake.wait_for(self._due)
                if self._closed:
                    break
            start = time.perf_counter()
            try:
                taken = self._take(start - before, idle)
                before = start
                frame = self.world.render(taken.shot)
                done = replace(taken, frame=frame, ms=1e3 * (time.perf_counter() - start))
                if handed is not None:
                    handed.result()
                handed = self._denoiser.submit(self._denoise, done)
            except InterruptedError:
                with self._wake:
                    # The frame is lost, and with it the motion of the next one.
                    self._cut = True
            except Exception as error:  # is told to those who look, who may go on
                with self._wake:
                    # The world's next frame has no motion, and the pipeline may have failed halfway.
                    self._frozen = self._cut = True
                self._broadcast({"error": f"{type(error).__name__}: {error}"})
                handed = None
        self.world.close()

    def _take(self, seconds: float, idle: bool) -> _Rendered:
        """The newest state, for the next frame."""
        with self._wake:
            state, number = self._state, self._number
            size = self.sizes.size
            if state.moving:
                # By frames when single steps are taken, and after pauses.
                self._flown += 1 / RATE if self._steps else min(seconds, 2 / RATE)
            shot = Shot(state.pose, size, state.light, flown(self._flown))
            cut, self._cut = self._cut, False
            self._rendered_change = self._change
            self._number += 1
            self._steps = max(self._steps - 1, 0)
            inputs = {viewer: viewer.input for viewer in self._viewers}
        return _Rendered(number, _NONE, shot, state, inputs, cut, self.world.seed, idle)

    def _denoise(self, got: _Rendered) -> None:
        start = time.perf_counter()
        frame = got.frame
        self._cuts += got.cut
        self._choose(got)
        output = self._pipeline.step(controls.adapted(got.state.pipeline, frame, got.number))
        done = time.perf_counter()
        self._samples.add(frame.color, (got.shot, self._cuts))
        wanted = self._wanted()
        # Pipelines without a viewer end here.
        self._extras = {name: self._extras[name] for name in self._extras.keys() & wanted}
        extra = {name: self._beside(name, frame) for name in wanted}
        moment = Moment(frame, output, self._samples.mean(), extra)
        self._last = got, moment
        self._keep(got)
        self._times["render"] = got.ms
        self._times["denoise"] = 1e3 * (done - start)
        self._show()
        shown = time.perf_counter()
        self._times["views"] = 1e3 * (shown - done)
        # After a pause, the time from the last picture to this one tells nothing.
        self._times["period"] = got.ms + 1e3 * (shown - start) if got.idle else 1e3 * (shown - self._shown_at)
        self._shown_at = shown
        with self._wake:
            if self.sizes.note(
                self._times["period"], resting=self._samples.count > _REST, fixed=self._recorder is not None
            ):
                self._changed()

    def _keep(self, got: _Rendered) -> None:
        """Record a frame, if that is asked for."""
        # A frame of another size may still be under way when a recording begins.
        if self._recorder is None or got.shot.size != self._recorder.size:
            return
        try:
            self._recorder.add(got.frame, got.shot, got.seed)
        except OSError as error:
            self._broadcast({"error": f"recording: {error}"})
            self._record(False)

    def _choose(self, got: _Rendered) -> None:
        """Make the pipeline that is wanted; forget history at a cut and at another size."""
        wanted = got.state.pipeline, got.state.parameters
        if wanted != self._made:
            self._pipeline, self._made = controls.build(*wanted), wanted
        elif got.cut or self._last is None or self._last[1].frame.shape != got.frame.shape:
            self._pipeline.reset()
        else:
            return
        self._extras.clear()

    def _wanted(self) -> set[str]:
        with self._wake:
            return {view for viewer in self._viewers for view in viewer.views} & _EXTRAS.keys()

    def _beside(self, name: str, frame: Frame) -> NDArray[np.float32] | None:
        """The result of a view's own pipeline."""
        if name not in self._extras:
            try:
                self._extras[name] = _EXTRAS[name]()
            except ImportError as error:
                self._extras[name] = None
                self._broadcast({"error": str(error)})
        if self._extras[name] is None:
            return None
        output: Output = self._extras[name].step(frame)
        return output.color

    def _record(self, on: bool) -> None:
        """Begin or end a recording; in the thread that denoises."""
        if on == (self._recorder is not None):
            return
        if on:
            try:
                self._recorder = Recorder(self.folder, self.world, self.sizes.size)
            except OSError as error:
                self._broadcast({"error": f"{error.filename}: {error.strerror}"})
        elif self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            self._recorded = str(recorder.folder)
            try:
                recorder.close()
            except OSError as error:
                self._broadcast({"error": f"recording: {error}"})
        with self._wake:
            self._wake.notify_all()

    def _repaint(self) -> None:
        """Show the newest frame again, as it is now asked for."""
        with self._wake:
            if self._painting:
                return
            self._painting = not self._closed
        self._later(self._again)

    def _again(self) -> None:
        with self._wake:
            self._painting = False
        if self._last is None:
            return
        _, moment = self._last
        for name in self._wanted() - moment.extra.keys():
            moment.extra[name] = self._beside(name, moment.frame)
        self._show()

    def _show(self) -> None:
        """Send the newest moment to everyone, each with the views and the exposure that they chose."""
        assert self._last is not None
        got, moment = self._last
        with self._wake:
            viewers = [*self._viewers]
        images: dict[tuple[str, float], memoryview] = {}
        for viewer in viewers:
            pair = [(name, viewer.exposure) for name in viewer.views]
            for each in pair:
                if each not in images:
                    images[each] = views.shown(each[0], moment, each[1]).data.cast("B")
            header = self._header(got, moment) | {"views": viewer.views, "input": got.inputs.get(viewer, 0)}
            viewer.send(packed(header, [images[each] for each in pair]))

    def _header(self, got: _Rendered, moment: Moment) -> dict[str, Any]:
        recorder = self._recorder
        return {
            "number": got.number,
            "size": got.shot.size,
            "level": self.sizes.level,
            "adapts": self.sizes.adapts,
            "pose": {"eye": got.shot.pose.eye, "target": got.shot.pose.target},
            "light": got.state.light,
            "moving": got.state.moving,
            "asked": {"light": self._state.light, "moving": self._state.moving},
            "frozen": self._frozen,
            "pipeline": got.state.pipeline,
            "parameters": got.state.parameters,
            "samples": self._samples.count,
            "ms": {name: round(value, 2) for name, value in self._times.items()},
            "used": moment.output.used,
            "recording": None if recorder is None else {"frames": recorder.count, "folder": str(recorder.folder)},
            "recorded": self._recorded,
        }

    def _broadcast(self, message: dict[str, Any]) -> None:
        with self._wake:
            viewers = [*self._viewers]
        for viewer in viewers:
            viewer.send(message)

    def _about(self) -> dict[str, Any]:
        """What a page needs to know before the first picture."""
        home = self.world.home
        return {
            "hello": {
                "version": __version__,
                "variant": self.world.variant,
                "scene": "Cornell box" if self.world.path is None else self.world.path.name,
                "rate": RATE,
                "samples": SAMPLES,
                "sizes": self.sizes.all,
                "home": {"eye": home.eye, "target": home.target, "up": home.up},
                "flies": self.world.flies,
                "lights": bool(self.world.lights),
                "views": views.plain(),
                "pipelines": controls.plain(),
            }
        }


#: Stands for the frame that is not rendered yet.
_NONE = Frame(np.zeros((1, 1, 3), np.float32))


def _boolean(message: Mapping[str, Any], name: str) -> bool:
    value = message[name]
    if not isinstance(value, bool):
        raise ValueError(f"{name}: expected true or false, got {value!r}")
    return value
