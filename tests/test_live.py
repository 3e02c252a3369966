"""The session behind `yester live`, without a renderer: what is rendered when, and who is shown what."""

import json
import math
import shutil
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yester
from yester.io import read_sequence
from yester.live import controls, views
from yester.live.samples import Samples
from yester.live.scene import Pose, Shot, flown
from yester.live.session import SAMPLES, Session, Viewer
from yester.live.sizes import Adaptation

HOME = Pose((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
SECONDS = 20


@dataclass
class Scene:
    """Stands for a renderer: its frames are as bright as its light, and each waits to be let through."""

    size: tuple[int, int] = (16, 12)
    flies: bool = False
    shots: list[Shot] = field(default_factory=list)
    home = HOME
    path = None
    variant = "none"
    fov = 40.0
    seed = 0

    def __post_init__(self):
        self.lights = ["lamp"]
        self.begun, self.gate = threading.Semaphore(0), threading.Semaphore(0)
        self.fails, self.error = False, RuntimeError("out of paint")

    def render(self, shot):
        self.shots.append(shot)
        self.begun.release()
        assert self.gate.acquire(timeout=SECONDS)
        if self.fails:
            raise self.error
        width, height = shot.size
        color = np.full((height, width, 3), 0.5 if shot.light else 0.01, np.float32)
        return yester.Frame(color, albedo=np.ones_like(color), depth=np.ones(color.shape[:2]))

    def close(self):
        pass


class Screen:
    """A viewer who keeps what is sent."""

    def __init__(self, session, **options):
        self.words, self.pictures, self.news = [], [], threading.Condition()
        self.session, self.viewer = session, Viewer(self.take, **options)
        session.join(self.viewer)

    def take(self, message):
        with self.news:
            if isinstance(message, bytes):
                length = int.from_bytes(message[:4], "little")
                header = json.loads(message[4 : 4 + length])
                width, height = header["size"]
                pixels = np.frombuffer(message[4 + length :], np.uint8).reshape(2, height, width, 4)
                self.pictures.append(SimpleNamespace(**header, images=pixels))
            else:
                self.words.append(message)
            self.news.notify_all()

    def tell(self, **message):
        self.session.tell(self.viewer, message)

    def until(self, wanted):
        """The first picture that is what is wanted."""
        with self.news:
            assert self.news.wait_for(lambda: any(map(wanted, self.pictures)), SECONDS)
            return next(filter(wanted, self.pictures))

    def errors(self, count):
        with self.news:
            found = lambda: [word["error"] for word in self.words if "error" in word]  # noqa: E731
            assert self.news.wait_for(lambda: len(found()) >= count, SECONDS)
            return found()


@pytest.fixture
def scene():
    return Scene()


@pytest.fixture
def session(scene, tmp_path):
    session = Session(scene, folder=tmp_path)
    yield session
    for _ in range(100):
        scene.gate.release()
    session.close()


def begun(scene):
    """Waits until the next frame is being rendered; tells its number."""
    assert scene.begun.acquire(timeout=SECONDS)
    return len(scene.shots) - 1


def pass_frames(scene, count):
    """Lets so many frames be rendered, one after the other."""
    for _ in range(count):
        begun(scene)
        scene.gate.release()


def test_hello(session):
    screen = Screen(session)
    hello = screen.words[0]["hello"]
    assert hello["home"] == {"eye": HOME.eye, "target": HOME.target, "up": HOME.up}
    assert [view["name"] for view in hello["views"]] == [*views.VIEWS]
    keys = [view["key"] for view in hello["views"]]
    assert len({*keys}) == len(keys)
    assert not {*keys} & {*" .xlks,[]+-="}
    assert hello["pipelines"].keys() >= {"SVGF", "TAA", "BMFR", "HalfRes", "Recirculation"}


def test_light_within_two_frames(scene, session):
    """What is switched while a frame is rendered shows in the next one: the second picture from then on."""
    screen = Screen(session, views=("raw", "denoised"))
    for _ in range(4):
        number = begun(scene)
        scene.gate.release()
    under_way = begun(scene)
    screen.tell(light=False)
    scene.gate.release()
    begun(scene)
    scene.gate.release()
    before, after = (screen.until(lambda p, n=n: p.number == n) for n in (under_way, under_way + 1))
    assert number + 1 == under_way
    assert (before.light, after.light) == (True, False)
    for side in (0, 1):
        assert after.images[side, ..., :3].mean() < before.images[side, ..., :3].mean() / 2


def test_newest_pose_wins(scene, session):
    screen = Screen(session)
    begun(scene)
    for number in range(1, 6):
        screen.tell(pose={"eye": [number, 0, 5], "target": [0, 0, 0]}, input=number)
    scene.gate.release()
    begun(scene)
    scene.gate.release()
    assert scene.shots[1].pose.eye == (5.0, 0.0, 5.0)
    assert [screen.until(lambda p, n=n: p.number == n).input for n in (0, 1)] == [0, 5]


def test_frames_do_not_queue(scene, session, monkeypatch):
    """While a frame is denoised, one is rendered, and no more."""
    screen = Screen(session)
    begun(scene)
    hold, entered = threading.Event(), threading.Event()
    show = session._show

    def slow():
        entered.set()
        assert hold.wait(SECONDS)
        show()

    monkeypatch.setattr(session, "_show", slow)
    for _ in range(10):
        scene.gate.release()
    begun(scene)
    assert entered.wait(SECONDS)
    time.sleep(0.2)
    assert len(scene.shots) == 2
    hold.set()
    screen.until(lambda p: p.number == 2)


def test_nothing_is_rendered_for_nobody(scene, session):
    first, second = Screen(session), Screen(session)
    begun(scene)
    session.leave(first.viewer)
    scene.gate.release()
    begun(scene)
    scene.gate.release()
    second.until(lambda p: p.number == 1)
    assert all(picture.number < 1 for picture in first.pictures)
    begun(scene)
    session.leave(second.viewer)
    scene.gate.release()
    time.sleep(0.2)
    assert len(scene.shots) == 3
    Screen(session)
    begun(scene)


def test_freeze_step_and_cut(scene, session):
    screen = Screen(session)
    begun(scene)
    screen.tell(freeze=True)
    scene.gate.release()
    screen.until(lambda p: p.number == 0 and p.frozen)
    screen.tell(light=False)  # not seen before the next frame
    assert screen.until(lambda p: not p.asked["light"]).light
    screen.tell(step=True)
    begun(scene)
    scene.gate.release()
    picture = screen.until(lambda p: p.number == 1)
    assert (picture.frozen, picture.light) == (True, False)
    time.sleep(0.1)
    assert len(scene.shots) == 2
    screen.tell(light=True, freeze=False)
    screen.tell(views=["history", "history"])
    pass_frames(scene, 4)
    old = screen.until(lambda p: p.number == 5 and p.views == ["history", "history"])
    begun(scene)
    screen.tell(cut=True)
    for _ in range(2):
        scene.gate.release()
        begun(scene)
    new = screen.until(lambda p: p.number == 7)
    assert old.samples == 4
    assert new.samples == 1
    assert old.images[0, 6, 8, 1] > new.images[0, 6, 8, 1]


def test_samples_add_up_while_nothing_changes(scene, session):
    screen = Screen(session)
    pass_frames(scene, 5)
    assert screen.until(lambda p: p.number == 4).samples == 5
    begun(scene)
    screen.tell(pose={"eye": [1, 0, 5], "target": [0, 0, 0]})
    for _ in range(3):
        scene.gate.release()
        begun(scene)
    assert [screen.until(lambda p, n=n: p.number == n).samples for n in (5, 6, 7)] == [6, 1, 2]


def test_stops_at_the_reference(scene, session):
    screen = Screen(session)
    begun(scene)
    session._samples.count = SAMPLES
    scene.gate.release(2)
    # The one that is rendered meanwhile is the last.
    session._denoiser.submit(lambda: None).result()
    time.sleep(0.2)
    count = len(scene.shots)
    assert count <= 2
    screen.tell(light=False)
    for _ in range(3):
        scene.gate.release()
    screen.until(lambda p: not p.light)
    assert len(scene.shots) > count


def test_further_pipelines_run_only_while_shown(scene, session):
    screen = Screen(session, views=("raw", "denoised"))
    begun(scene)
    scene.gate.release()
    screen.until(lambda p: p.number == 0)
    assert session._extras == {}
    screen.tell(views=["antialiased", "raw"])
    picture = screen.until(lambda p: p.views == ["antialiased", "raw"])
    np.testing.assert_allclose(picture.images[0], picture.images[1], atol=1)
    assert session._extras.keys() == {"antialiased"}
    screen.tell(views=["raw", "raw"])
    begun(scene)
    scene.gate.release()
    begun(scene)
    scene.gate.release()
    screen.until(lambda p: p.number == 2)
    assert session._extras == {}


def test_every_viewer_has_views_and_exposure_of_its_own(scene, session):
    dark, bright = Screen(session, views=("raw", "albedo")), Screen(session, views=("albedo", "raw"), exposure=1)
    begun(scene)
    scene.gate.release()
    one, other = (screen.until(lambda p: p.number == 0) for screen in (dark, bright))
    np.testing.assert_array_equal(one.images[1], other.images[0])
    assert one.images[0, 0, 0].tolist() == [188, 188, 188, 255]
    assert other.images[1, 0, 0].tolist() == [255, 255, 255, 255]
    dark.tell(exposure=-1)
    assert dark.until(lambda p: p.images[0, 0, 0, 0] != 188).images[0, 0, 0, 0] == 137


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ({"nonsense": 1}, "message: expected some of .*, got 'nonsense'"),
        ({"pose": {"eye": [0, 0, 1]}}, "pose: expected eye and target"),
        ({"pose": {"eye": [0, 0, math.nan], "target": [0, 0, 0]}}, "eye: expected three finite numbers"),
        ({"pose": {"eye": [0, 3, 0], "target": [0, 0, 0]}}, "target: expected a point that is not above"),
        ({"views": ["raw"]}, "views: expected two of raw, "),
        ({"views": ["raw", "nothing"]}, "views: expected two of raw, "),
        ({"views": [[], "raw"]}, "views: expected two of raw, "),
        ({"pose": {"eye": [10**400, 0, 1], "target": [0, 0, 0]}}, "pose: expected eye and target"),
        ({"pose": {"eye": [0, 0, 1], "target": [0, 0, 0]}, "input": math.inf}, "input: expected a whole number"),
        ({"pipeline": []}, "pipeline: expected one of SVGF, "),
        ({"exposure": 1e9}, "exposure: expected -20 to 20 stops"),
        ({"exposure": "1"}, "exposure: expected -20 to 20 stops"),
        ({"pipeline": "magic"}, "pipeline: expected one of SVGF, "),
        ({"pipeline": "SVGF", "parameters": [1]}, "parameters: expected a mapping"),
        ({"pipeline": "SVGF", "parameters": {"alfa": 1}}, "parameters: expected some of .*, got 'alfa'"),
        ({"pipeline": "SVGF", "parameters": {"alpha": 2}}, "alpha: expected a fraction from 0 to 1"),
        ({"pipeline": "SVGF", "parameters": {"iterations": 1.5}}, "parameters: "),
        ({"light": 1}, "light: expected true or false"),
        ({"size": 99}, "size: expected 0 to "),
    ],
)
def test_bad_messages(session, message, error):
    screen = Screen(session)
    with pytest.raises(ValueError, match=error):
        screen.tell(**message)
    assert session._state.pose == HOME
    assert session._state.pipeline == "SVGF"


def test_pipeline_is_chosen(scene, session):
    screen = Screen(session)
    begun(scene)
    screen.tell(pipeline="TAA", parameters={"preset": "textbook"})
    for _ in range(2):
        scene.gate.release()
        begun(scene)
    assert screen.until(lambda p: p.number == 1).pipeline == "TAA"
    assert repr(session._pipeline) == "TAA(preset='textbook')"


def test_errors_are_told(scene, session):
    screen = Screen(session)
    begun(scene)
    scene.fails = True
    scene.gate.release()
    assert screen.errors(1) == ["RuntimeError: out of paint"]
    scene.fails = False
    screen.tell(freeze=False)
    begun(scene)
    scene.gate.release()
    screen.until(lambda p: not p.frozen)


def test_history_begins_anew_after_an_error(scene, session):
    """As the motion of the next frame does, which is zero."""
    screen = Screen(session)
    pass_frames(scene, 3)
    assert screen.until(lambda p: p.number == 2).samples == 3
    begun(scene)
    scene.fails = True
    scene.gate.release()
    screen.errors(1)
    scene.fails = False
    screen.tell(freeze=False)
    begun(scene)
    scene.gate.release()
    assert screen.until(lambda p: p.number == 4).samples == 1


def test_an_interrupted_frame_is_left_out(scene, session):
    """As Mitsuba ends on SIGINT in any thread, also where that is not the end of the program, as in a notebook."""
    screen = Screen(session)
    scene.error = InterruptedError("rendering was interrupted")
    pass_frames(scene, 3)
    begun(scene)
    scene.fails = True
    scene.gate.release()
    begun(scene)
    scene.fails = False
    scene.gate.release()
    picture = screen.until(lambda p: p.number == 4)
    assert (picture.samples, picture.frozen) == (1, False)
    assert not any("error" in word for word in screen.words)


def test_recording(scene, session, tmp_path):
    screen = Screen(session)
    begun(scene)
    screen.tell(record=True)
    session._denoiser.submit(lambda: None).result()
    with pytest.raises(ValueError, match="size: expected the same as long as frames are recorded"):
        screen.tell(size=0)
    for _ in range(3):
        scene.gate.release()
        begun(scene)
    screen.until(lambda p: p.recording and p.recording["frames"] == 3)
    screen.tell(record=False)
    picture = screen.until(lambda p: p.recorded)
    assert [frame.color.shape for frame in read_sequence(picture.recorded + "/frames")] == [(12, 16, 3)] * 3
    path = json.loads((tmp_path / picture.recorded / "path.json").read_text())
    assert [shot["pose"]["eye"] for shot in path["shots"]] == [[0, 0, 5]] * 3


def test_recording_that_fails_keeps_its_path(scene, session):
    """As on a disk that is full: the frames are lost, not the rest, and the thread that writes ends."""
    screen = Screen(session)
    begun(scene)
    screen.tell(record=True)
    session._denoiser.submit(lambda: None).result()
    shutil.rmtree(session._recorder.folder / "frames")
    for _ in range(6):
        scene.gate.release()
        begun(scene)
    picture = screen.until(lambda p: p.recorded)
    assert picture.recording is None
    assert "No such file or directory" in screen.errors(1)[0]
    assert len(json.loads(Path(picture.recorded, "path.json").read_text())["shots"]) == 4
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("yester-record")]


def test_recording_cannot_be_written(scene, session, tmp_path):
    session.folder = tmp_path / "file"
    session.folder.write_text("")
    screen = Screen(session)
    screen.tell(record=True)
    assert str(session.folder) in screen.errors(1)[0]


def test_whatever_ends_a_recording_is_told(scene, session, monkeypatch):
    def full(*_):
        raise MemoryError("no room")

    monkeypatch.setattr("yester.live.session.Recorder", full)
    screen = Screen(session)
    screen.tell(record=True)
    assert screen.errors(1) == ["MemoryError: no room"]


def test_messages_after_the_end(scene, session):
    """They come from pages that do not know yet."""
    screen = Screen(session)
    for _ in range(100):
        scene.gate.release()
    session.close()
    screen.tell(record=True)
    screen.tell(views=["history", "history"])
    assert not any(Path(session.folder).glob("yester-live-*"))


def test_controls_have_the_ranges_of_the_pipelines():
    """Each limit is accepted, or for open ones its neighbourhood; what is beyond is refused."""
    named = {control["name"]: control for control in controls.controls("SVGF")}
    assert (named["alpha"]["low"], named["alpha"]["high"], named["alpha"]["default"]) == (0, 1, 0.2)
    assert (named["iterations"]["whole"], named["iterations"]["high"]) == (True, 16)
    assert (named["sigma_normal"]["low"], named["sigma_normal"]["high"]) == (0, None)
    assert named["choice"]["kind"] == "switch"
    assert named["reflections"]["kind"] == "list"
    for pipeline in ("SVGF", "BMFR", "HalfRes", "TAA", "Recirculation"):
        for control in controls.controls(pipeline):
            assert control["about"]
            for limit, sign in (("low", -1), ("high", 1)):
                if control.get(limit) is not None:
                    inside, outside = control[limit] - sign * 1e-6, control[limit] + sign * 1e-3
                    if control["whole"]:
                        inside, outside = int(control[limit]), int(control[limit]) + sign
                    controls.build(pipeline, {control["name"]: inside})
                    with pytest.raises(ValueError, match="expected"):
                        controls.build(pipeline, {control["name"]: outside})
            for one in control.get("among", ()):
                try:
                    controls.build(pipeline, {control["name"]: one})
                except ValueError as error:  # some go only with certain values of others
                    assert not str(error).startswith(f"{control['name']}:")  # noqa: PT017
    assert {c["name"]: c.get("among") for c in controls.controls("TAA")}["window"] == ["3x3", "5x5"]


def test_views_of_a_frame():
    rng = np.random.default_rng(0)
    color, flat = rng.random((4, 6, 3)).astype(np.float32), np.full((4, 6), 2, np.float32)
    color[0, 0] = np.nan
    motion = np.zeros((4, 6, 2), np.float32)
    motion[1, 1] = 8, 0
    frame = yester.Frame(
        color, albedo=np.ones_like(color), normal=np.ones_like(color) * [0, 0, 1], depth=flat, motion=motion
    )
    output = yester.SVGF().step(frame)
    moment = views.Moment(frame, output, color)
    found = {name: views.shown(name, moment, 0) for name in views.VIEWS}
    assert {image.shape for image in found.values()} == {(4, 6, 4)}
    assert {tuple(image[0, 0, :3]) for name, image in found.items() if name in ("antialiased", "oidn")} == {(64,) * 3}
    want = yester.metrics.srgb(color[2, 2]) * 255
    np.testing.assert_allclose(found["raw"][2, 2, :3], want, atol=1)
    assert found["raw"][0, 0].tolist() == [0, 0, 0, 255]
    assert found["normal"][1, 1].tolist() == [128, 128, 255, 255]
    assert found["motion"][1, 1, :3].max() == 255
    assert found["motion"][0, 1, :3].max() == 0
    assert found["depth"][1, 1].tolist() == [251, 252, 191, 255]


def test_mean_of_samples():
    rng = np.random.default_rng(0)
    first, second, third = rng.random((3, 2, 3, 3)).astype(np.float32)
    second[0, 0, 1] = np.inf
    samples = Samples()
    samples.add(first, "this")
    np.testing.assert_array_equal(samples.mean(), first)
    samples.add(second, "this")
    want = (first + second) / 2
    want[0, 0] = first[0, 0]
    np.testing.assert_allclose(samples.mean(), want, rtol=1e-6)
    samples.add(third, "that")
    np.testing.assert_array_equal(samples.mean(), third)
    assert samples.count == 1


def adapt(sizes, milliseconds):
    """The sizes that are chosen where a frame takes a time that is a function of its pixels."""
    seen = [sizes.size]
    for _ in range(300):
        width, height = sizes.size
        if sizes.note(milliseconds(width * height), resting=False, fixed=False):
            seen.append(sizes.size)
    return seen


@pytest.mark.parametrize(
    ("milliseconds", "last"),
    [
        (lambda pixels: pixels / 768, (320, 240)),  # 100 ms at 320×240
        (lambda pixels: pixels / 192, (160, 120)),
        (lambda pixels: pixels / 10_000, (640, 480)),
        (lambda pixels: 60 + pixels / 1000, (160, 120)),
        (lambda pixels: 200 + pixels / 1e6, (160, 120)),  # smaller ones do not help: tried once
    ],
)
def test_size_adapts(milliseconds, last):
    seen = adapt(Adaptation((640, 480), 10), milliseconds)
    assert seen[-1] == last
    assert len(seen) < 6


def test_size_stays():
    sizes = Adaptation((640, 480), 10)
    assert not any(sizes.note(1000, resting=True, fixed=False) for _ in range(50))
    assert not any(sizes.note(1000, resting=False, fixed=True) for _ in range(50))
    sizes.fix(1)
    assert adapt(sizes, lambda pixels: 1000.0) == [(480, 360)]
    assert adapt(Adaptation((640, 480), 10, adapt=False), lambda pixels: 1000.0) == [(640, 480)]


def test_cube_flies_there_and_back():
    assert [flown(seconds) for seconds in (0, 2, 4, 6, 8)] == [0, 0.5, 1, 0.5, 0]
