"""Do no harm, on small versions: no default component of SVGF makes it worse, no buffer that is given, and no plan.

A small version is a window of 80×60 pixels of the study's frames, eight frames long: surfaces have as many pixels and
move as fast as in the study, which scaled images would not keep. `yester chart --ablate --doors` measures whole ones.
"""

from functools import cache

import numpy as np
import pytest
from yester import Camera
from yester.io import write_exr
from yester.study.compare import ablation, doors, harm, judging
from yester.study.compare.ablation import ABLATIONS
from yester.study.rendered import recording, scenes, sequences
from yester.study.rendered.recording import Recording

pytestmark = [pytest.mark.slow, pytest.mark.long]

#: The study's size and length; the frames and the size of the window; which of its frames have references.
WIDTH, HEIGHT, FRAMES = 256, 192, 16
PART, WINDOW, CLEAN = slice(4, 12), (80, 60), range(5, 8)
#: The size at which components are timed; these times are not used here.
TIMED = (64, 48)
#: The middle of the window, in fractions of the image.
MIDDLES = {
    "black_plastic": (0.62, 0.6),
    "glassware": (0.45, 0.6),
    "naked_lamps": (0.53, 0.4),
    "grass": (0.5, 0.42),
    "fast_dolly": (0.5, 0.55),
    "cornell_box": (0.6, 0.65),
    "glossy_plates": (0.45, 0.5),
    "thicket": (0.5, 0.5),
}
#: The same on rough metal, of which renderers give an albedo that is no reflectance.
METAL = {"brushed_metal": (0.5, 0.5)}
#: The rule's limits, 0.1 dB and 2 %, plus three standard deviations of a gain from one seed of the noise to another:
#: 0.11 dB, 9 %, 1.1 % and 2 %, root mean squares over the components and doors of such windows.
LIMITS = {"psnr": 0.45, "relmse": 0.3, "flip": 0.06, "temporal_error": 0.08}
COMPONENTS = [each for each in ABLATIONS if each.whole.name == "SVGF" and each.whole.default and not each.added]


def part(name):
    """A window of some frames of a sequence."""
    whole = sequences.find(name)(FRAMES, WIDTH, HEIGHT)
    width, height = WINDOW
    crop = np.diag([WIDTH / width, HEIGHT / height, 1.0, 1.0])
    x, y = (MIDDLES | METAL)[name]
    crop[:2, 3] = crop[0, 0] * (1 - 2 * x), crop[1, 1] * (2 * y - 1)
    cameras = [Camera(crop @ camera.world_to_clip, width, height) for camera in whole.cameras[PART]]
    return scenes.Sequence(whole.scene, cameras, whole.transforms[PART], whole.parameters[PART])


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")

    @cache
    def record(name):
        sequence = part(name)
        every = range(len(sequence.cameras))
        made = {
            "noisy": (every, (frame for (frame,) in recording.render_noisy(sequence, every, seed=0))),
            "clean": (CLEAN, recording.render_clean(sequence, CLEAN, spp=64)),
            "raw": (every, recording._raw_albedo(sequence, every, seed=0)),
        }
        paths = []
        for kind, (numbers, frames) in made.items():
            (folder / name / kind).mkdir(parents=True)
            paths.append({i: folder / name / kind / f"{i}.exr" for i in numbers})
            for path, frame in zip(paths[-1].values(), frames, strict=True):
                write_exr(path, frame)
        noisy, clean, raw = paths
        return Recording(name, [*noisy.values()], clean, raw)

    return record


@pytest.mark.parametrize("name", MIDDLES)
def test_components(record, tmp_path, name):
    """SVGF without a component is not better."""
    found = ablation.harmful(ablation.ablate([record(name)], tmp_path, ablations=COMPONENTS, size=TIMED), LIMITS)
    assert found == []


@pytest.mark.parametrize("name", MIDDLES)
def test_later_frames(record, tmp_path, name):
    """SVGF with earlier and later frames, as in `yester denoise`, is not worse than with earlier ones alone."""
    (later,) = (each for each in ABLATIONS if each.component == "later frames")
    (effect,) = ablation.ablate([record(name)], tmp_path, ablations=[later], size=TIMED)
    assert effect.name == "SVGF + later frames"
    assert harm.harms(effect.gains, LIMITS) == []


@pytest.mark.parametrize("name", MIDDLES)
def test_buffers(record, tmp_path, name):
    """SVGF through a poorer door is not better."""
    assert doors.harmful(doors.measure_doors([record(name)], doors.METHODS[:1], tmp_path), LIMITS) == []


@pytest.mark.parametrize("name", MIDDLES)
def test_plans(record, name):
    """The plan of `yester denoise` is not worse than the default, through any door."""
    found = [judging.worth(record(name), door) for door in doors.DOORS]
    harms = [(each.door, harm.harms(gains, LIMITS)) for each in found for gains in (each.gains, each.both)]
    assert [each for each in harms if each[1]] == []


@pytest.mark.parametrize("name", METAL)
def test_albedo_of_metal(record, tmp_path, name):
    """Raw albedo, which had been worse than none by 6 dB, and by 3 dB without ids."""
    names = doors.FULL, "no albedo", "raw albedo", "no ids", "raw albedo, no ids", "no albedo, no ids"
    chosen = [door for door in doors.DOORS if door.name in names]
    assert doors.harmful(doors.measure_doors([record(name)], doors.METHODS[:1], tmp_path, doors=chosen), LIMITS) == []
