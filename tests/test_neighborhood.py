import itertools

import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

BOXES = ["variance", "minmax", "rounded", "intersection"]
SPACES = ["rgb", "ycocg", "tonemapped-rgb", "tonemapped-ycocg"]
RESPONSES = ["clamp", "center", "current", "ellipsoid"]
HULLS = ["hull", "exact-hull", "chroma-hull"]
MODES = [(box, response) for box in BOXES for response in RESPONSES if response != "ellipsoid" or box == "variance"]
MODES += [(box, "current") for box in HULLS]
CASES = [(*mode, space) for mode in MODES for space in SPACES if mode[0] != "chroma-hull" or "ycocg" in space]
PLAIN = [case for case in CASES if "tonemapped" not in case[2]]


def images(rng, height, width):
    """A noisy frame, and history about half of which lies inside its boxes; with holes and negative colours."""
    color = rng.normal(1, 0.4, (height, width, 3))
    history = color + rng.normal(0, 0.5, color.shape) * rng.choice([0, 0.3, 2], (height, width, 1))
    color[rng.random((height, width)) < 0.05] = np.nan
    history[rng.random((height, width)) < 0.02, 1] = np.inf
    return history.astype(np.float32), color.astype(np.float32)


def check(history, color, **named):
    got = yester.clip_history(history, color, **named)
    want, grazing = reference.clip_history(tensor(history), tensor(color), margin=True, **named)
    # Undoing the tone curve multiplies errors where it is steep.
    scale = 30.0 if "tonemapped" in named.get("space", "") else 2.0
    assert (grazing > 100).sum() <= 3 + 0.03 * grazing.numel()
    assert_close("clip_history", got, want, scale=scale * grazing.numpy()[..., None])
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 20), st.integers(1, 40)),
    case=st.sampled_from(PLAIN),
    gamma=st.sampled_from([0.0, 0.75, 1.0, 1.5]),
    window=st.sampled_from(["3x3", "5x5"]),
    exposure=st.sampled_from([1.0, 0.3]),
)
def test_reference(seed, size, case, **named):
    box, response, space = case
    check(*images(np.random.default_rng(seed), *size), box=box, response=response, space=space, **named)


@each(("box", "response", "space"), CASES)
def test_every_mode(box, response, space):
    """Both sides of every box occur."""
    history, color = (np.abs(image) for image in images(np.random.default_rng(3), 33, 41))
    got = check(history, color, box=box, response=response, space=space, exposure=0.5)
    kept = (got == history).all(-1).mean()
    assert 0.05 < kept < 0.95


@pytest.mark.parametrize("named", [{}, *({"box": box, "response": "current"} for box in HULLS)])
@each("size", SIZES + TAILS[::8])
def test_sizes(size, named):
    check(*images(np.random.default_rng(size[1]), *size), **named)


@each(("box", "response", "space"), PLAIN)
def test_inside_keeps_its_bits(box, response, space):
    """Each pixel's own colour lies in its range; the neighbourhood's mean lies in every box."""
    rng = np.random.default_rng(5)
    color = rng.random((8, 9, 3), np.float32)
    color[:, 1::2] = 1 - color[:, :-1:2]  # around grey
    history = np.full_like(color, 0.5) + rng.normal(0, 1e-3, color.shape).astype(np.float32)
    got = yester.clip_history(history, color, box=box, response=response, space=space, gamma=1.5)
    assert_same_bits(got[2:-2, 2:-2], history[2:-2, 2:-2])


@each(("box", "response", "space"), CASES)
def test_a_uniform_neighbourhood_leaves_one_colour(box, response, space):
    """Without variance or range, any history becomes that colour."""
    color = np.full((5, 6, 3), (0.5, 0.25, 0.125), np.float32)
    history = np.random.default_rng(0).exponential(3, color.shape).astype(np.float32)
    got = yester.clip_history(history, color, box=box, response=response, space=space)
    np.testing.assert_allclose(got, color, rtol=1e-5)


@pytest.mark.parametrize("response", ["clamp", "center", "current"])
@pytest.mark.parametrize("box", BOXES)
def test_results_are_inside(box, response):
    """Clipping once more changes nothing but rounding."""
    history, color = images(np.random.default_rng(7), 30, 30)
    named = {"box": box, "response": response, "space": "rgb"}
    once = yester.clip_history(history, color, **named)
    np.testing.assert_allclose(yester.clip_history(once, color, **named), once, rtol=1e-5, atol=1e-6)


def test_a_firefly_does_not_save_bad_history():
    """The current colour lies outside its own variance box; equal history is clipped all the same."""
    color = np.full((5, 5, 3), 0.1, np.float32)
    color[2, 2] = 50
    history = np.full_like(color, 50)
    got = yester.clip_history(history, color, response="current", space="rgb")[2, 2]
    deviation = color[1:4, 1:4, 0].std()
    assert (got <= color[1:4, 1:4, 0].mean() + deviation * 1.0001).all()


@each("brightness", [1e4, 1e8])
@each(("box", "response", "space"), [case for case in PLAIN if case[1] == "current"])
def test_fireflies_in_history_leave_no_trace(box, response, space, brightness):
    """However far outside history lies, the result is as precise as the colours around."""
    rng = np.random.default_rng(13)
    color = rng.random((20, 20, 3), np.float32)
    history = rng.uniform(0.5, 1, color.shape).astype(np.float32) * np.float32(brightness)
    named = {"box": box, "response": response, "space": space}
    got = yester.clip_history(history, color, **named)
    np.testing.assert_allclose(got, reference.clip_history(*tensor([history, color]), **named), atol=1e-5)


def test_scale_does_not_matter():
    history, color = images(np.random.default_rng(9), 20, 20)
    for box, response in MODES:
        small = yester.clip_history(history, color, box=box, response=response)
        big = yester.clip_history(history * 1024, color * 1024, box=box, response=response)
        assert_same_bits(big, small * np.float32(1024))


@pytest.mark.parametrize("box", HULLS)
@pytest.mark.parametrize("window", ["3x3", pytest.param("5x5", marks=pytest.mark.slow)])
@pytest.mark.parametrize("steps", [2, 4, 8])
def test_hulls_of_few_colours(box, window, steps):
    """Exact in float32: equal points, collinear points, history on edges and corners, which stays."""
    rng = np.random.default_rng(steps)
    color = rng.integers(-1, steps, (40, 41, 3)).astype(np.float32)
    history = color + rng.integers(-1, 2, color.shape).astype(np.float32)
    color[rng.random((40, 41)) < 0.3] = np.inf
    for image in (history, color):
        image[5:20, 5:20, 1:] = image[5:20, 5:20, :1]  # grey
    if (box, window) == ("exact-hull", "5x5"):  # the reference looks at thousands of directions
        history, color = history[2:9, :14], color[2:9, :14]
    named = {"box": box, "window": window, "response": "current"}
    got = yester.clip_history(history, color, **named)
    want, grazing = (part.numpy() for part in reference.clip_history(*tensor([history, color]), margin=True, **named))
    assert_close("clip_history", got, want, scale=steps * grazing[..., None])
    present = np.isfinite(color).all(-1)  # a mean is rounded, and only nearly touches the hull that it lies on
    room = 1e-5 if box == "exact-hull" else 1e-6  # its flat hulls are a millionth thick
    np.testing.assert_allclose(got[present], want[present], atol=room * steps)
    stays = (want == history).all(-1)
    assert 0.2 < stays[present].mean() < 0.98
    np.testing.assert_array_equal(got[stays & present], history[stays & present])


@pytest.fixture(scope="module", params=HULLS)
def clipped(request):
    """A hull, history, colour, the result, and per pixel the neighbours (T, H, W, 3), NaN outside; all in YCoCg."""
    history, color = images(np.random.default_rng(11), 40, 40)
    got = yester.clip_history(history, color, box=request.param, response="current")
    to_ycocg = np.array([[1, 2, 1], [2, 0, -2], [-1, 2, -1]]).T / 4
    with np.errstate(invalid="ignore"):
        history, color, got = (image.astype(np.float64) @ to_ycocg for image in (history, color, got))
    color[~np.isfinite(color).all(-1)] = np.nan
    padded = np.pad(color, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[y : y + 40, x : x + 40] for y, x in np.ndindex(3, 3)])
    known = np.isfinite(history).all(-1)
    assert known.mean() > 0.9
    return request.param, history[known], color[known], got[known], around[:, known]


def beyond(box, points, around):
    """How far points (P,) lie outside the hull, in the worst of its directions, or of many directions."""
    if box == "exact-hull":
        corners = np.stack([around[list(three)] for three in itertools.combinations(range(9), 3)])  # (84, 3, P, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # (84, P, 3)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.concatenate([normals, -normals])
        most = np.max([np.nan_to_num((tap * normals).sum(-1), nan=-np.inf) for tap in around], 0)  # (168, P)
        return np.nanmax((points * normals).sum(-1) - most, 0)
    if box == "hull":
        directions = np.stack([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
    else:
        angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
        directions = np.stack([0 * angle, np.cos(angle), np.sin(angle)], -1)
        directions = np.concatenate([directions, [[1, 0, 0], [-1, 0, 0]]])
    return (points @ directions.T - np.nanmax(around @ directions.T, 0)).max(-1)


def test_history_outside_a_hull_moves_to_its_surface(clipped):
    """To its surface, along the segment to the current colour or the mean; history inside stays."""
    box, history, color, got, around = clipped
    target = np.where(np.isfinite(color), color, np.nanmean(around, 0))
    moved = (got != history).any(-1)
    outside = beyond(box, history, around)
    assert 0.2 < moved.mean() < 0.9
    assert moved[outside > 1e-6].all()
    inside = outside < (-1e-3 if box == "exact-hull" else -1e-2)  # the last is tested along some directions
    assert inside.mean() > 0.1
    assert not moved[inside].any()
    assert beyond(box, got, around).max() < 3e-6
    way, gone = (target - history)[moved], (got - history)[moved]
    t = (gone * way).sum(-1) / (way**2).sum(-1)
    assert t.min() > 0
    assert t.max() < 1 + 1e-5
    np.testing.assert_allclose(gone, t[:, None] * way, atol=3e-6)
    # A shorter step would stay outside: the result lies on the surface. Rounded directions detect a corner late.
    before = history[moved] + (t * 0.97)[:, None] * way
    assert (beyond(box, before, around[:, moved]) > 0).mean() > 0.97


def test_hulls_are_tighter_than_boxes():
    """A ramp from red to green: its box has corners that no mixture reaches, yellow and black."""
    x = np.linspace(0, 1, 9, dtype=np.float32).reshape(3, 3)
    color = np.stack([x, 1 - x, 0 * x], -1)
    yellow = np.full_like(color, (1, 1, 0))
    in_box = yester.clip_history(yellow, color, box="minmax", response="current", space="rgb")[1, 1]
    assert_same_bits(in_box, yellow[1, 1])
    in_hull = yester.clip_history(yellow, color, box="hull", response="current", space="rgb")[1, 1]
    np.testing.assert_allclose(in_hull, [0.5, 0.5, 0], atol=1e-6)
    # Chroma does not limit brightness; Y has a range of its own, here from 1/4 to 1/2.
    in_chroma = yester.clip_history(yellow, color, box="chroma-hull", response="current")[1, 1]
    np.testing.assert_allclose(in_chroma, [0.5, 0.5, 0], atol=1e-6)


def test_the_exact_hull_is_the_tightest():
    """The hull of four colours is a tetrahedron, much tighter than the 26-DOP; mixtures of them stay."""
    corners = np.float32([[0, 0, 0], [1, 2, 0], [2, 0, 1], [0, 1, 3]])
    color = corners[[0, 1, 2, 3, 0, 1, 2, 3, 0]].reshape(3, 3, 3)
    shares = np.random.default_rng(0).dirichlet(np.ones(4), 500)
    named = {"response": "current", "space": "rgb"}

    def clip(middle, box):
        history = color.copy()
        history[1, 1] = middle
        return yester.clip_history(history, color, box=box, **named)[1, 1]

    for mixture in (shares @ corners).astype(np.float32):
        inside = mixture * np.float32(0.999) + np.float32(0.001) * corners.mean(0)
        assert_same_bits(clip(inside, "exact-hull"), inside)
    # Outside the facet of the last three, on the ray from the first through a point of the facet.
    for share in np.random.default_rng(1).dirichlet(np.ones(3), 100):
        on_it = share @ corners[1:]
        np.testing.assert_allclose(clip(1.5 * on_it, "exact-hull"), on_it, rtol=1e-6, atol=1e-6)
        assert (clip(1.5 * on_it, "hull") >= clip(1.5 * on_it, "exact-hull") - 1e-6).all()
    behind = [1.5 * share @ corners[1:] for share in np.random.default_rng(2).dirichlet(np.ones(3), 100)]
    outer, inner = (np.mean([clip(middle, box).sum() for middle in behind]) for box in ("hull", "exact-hull"))
    assert outer > 1.05 * inner


def test_flat_hulls_are_a_millionth_thick():
    """A material of one hue lies on a line, one under two lights in a plane, up to rounding: mixtures stay."""
    rng = np.random.default_rng(0)
    hues = np.float32([[0.7, 0.6, 0.5], [0.1, 0.5, 0.9]])
    for lights, kept in ((1, 0.9), (2, 0.6)):
        color, history = (
            rng.uniform(*span, (24, 31, lights)).astype(np.float32) @ hues[:lights]
            for span in ((0.8, 1.2), (0.95, 1.05))
        )
        for space in ("rgb", "ycocg"):
            got = yester.clip_history(history, color, box="exact-hull", response="current", space=space)
            assert (got == history).all(-1).mean() > kept


def of_ycocg(*colors):
    """One row (1, W, 3) of RGB."""
    return np.float32([colors]) @ np.float32([[1, 1, 1], [1, 0, -1], [-1, 1, -1]])


def test_two_chrominances_are_a_segment():
    """Points on it keep their bits; points beside it or beyond its ends become the current colour."""
    color = of_ycocg((0.5, -0.25, 0.125), (1, 0.25, -0.125))

    def clip(*history):
        pixel = of_ycocg(history).repeat(2, 1)
        return yester.clip_history(pixel, color, box="chroma-hull", response="current"), pixel

    for share in (0, 0.25, 0.5, 0.75, 1):
        for y in (0.5, 0.625, 1):
            assert_same_bits(*clip(y, -0.25 + 0.5 * share, 0.125 - 0.25 * share))
    for beside in ((0.75, 0, 0.125), (0.75, 0.25, 0.25), (0.75, -0.5, 0.25), (0.75, 0, 2.0**-10)):
        got, _ = clip(*beside)
        ends = color
        if beside == (0.75, -0.5, 0.25):  # collinear: to the nearer end on the way
            ends = of_ycocg((2 / 3, -0.25, 0.125), (0.75 + 0.25 / 3, -0.25, 0.125))
            ends[0, 0] = color[0, 0]  # the colour at that end
        np.testing.assert_allclose(got, ends, atol=1e-6)
    # Too bright: moved towards the colour until Y is in range.
    got, _ = clip(1.5, 0, 0)
    np.testing.assert_allclose(got, of_ycocg((1, -0.125, 0.0625), (1, 0.25, -0.125)), atol=1e-6)


def test_one_chrominance_is_a_point():
    """Greys differ in Y alone: coloured history is replaced, grey history is clamped to their range."""
    grey = np.float32([[[0.25] * 3, [0.5] * 3, [1] * 3]])
    named = {"box": "chroma-hull", "response": "current"}
    coloured = np.full_like(grey, (0.5, 0.375, 0.5))
    np.testing.assert_allclose(yester.clip_history(coloured, grey, **named), grey, atol=1e-6)
    inside = np.full_like(grey, 0.5)
    assert_same_bits(yester.clip_history(inside, grey, **named), inside)
    np.testing.assert_allclose(
        yester.clip_history(0 * grey, grey, **named), np.float32([[[0.25] * 3, [0.25] * 3, [0.5] * 3]]), atol=1e-6
    )


@pytest.mark.parametrize("box", HULLS)
def test_hulls_with_missing_colours(box):
    """A missing current colour: towards the mean of the others. An infinite channel counts as missing."""
    rng = np.random.default_rng(2)
    history, color = (rng.random((7, 8, 3), np.float32) for _ in range(2))
    history[::2] -= 1
    holes = rng.random((7, 8)) < 0.3
    color[holes] = np.nan
    infinite = color.copy()
    infinite[holes] = rng.permuted(np.float32([np.inf, 1, 1]).repeat(holes.sum()).reshape(3, -1).T, axis=1)
    got = check(history, color, box=box, response="current")
    assert np.isfinite(got).all()
    assert_same_bits(yester.clip_history(history, infinite, box=box, response="current"), got)


def test_missing_pixels():
    """Missing pixels do not count, and history stays where there is nothing else."""
    color = np.full((4, 4, 3), np.nan, np.float32)
    history = np.ones_like(color)
    assert_same_bits(yester.clip_history(history, color), history)
    color[0, 0] = 0.5
    got = yester.clip_history(history, color)
    np.testing.assert_array_equal(got[:2, :2], 0.5)
    np.testing.assert_array_equal(got[2:], 1)
    history[1, 1, 0] = np.nan
    assert_same_bits(yester.clip_history(history, color)[1, 1], history[1, 1])


@pytest.mark.parametrize("response", ["center", "current", "clamp", "ellipsoid"])
def test_rounding_does_not_decide_where_the_box_is_flat(response):
    """A material of one hue lies on a line in YCoCg, up to rounding; history on that line is kept."""
    rng = np.random.default_rng(0)
    hue = np.float32([0.7, 0.6, 0.5])
    color = rng.uniform(0.8, 1.2, (24, 31, 1)).astype(np.float32) * hue
    history = rng.uniform(0.98, 1.02, (24, 31, 1)).astype(np.float32) * hue
    got = yester.clip_history(history, color, response=response)
    assert (got == history).all(-1).mean() > 0.9


def test_bad_input():
    image = np.ones((4, 5, 3), np.float32)
    for name in ("box", "window", "space", "response"):
        with pytest.raises(ValueError, match=rf'{name}: expected one of ".*", got "none"'):
            yester.clip_history(image, image, **{name: "none"})
    for gamma in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="gamma"):
            yester.clip_history(image, image, gamma=gamma)
    with pytest.raises(ValueError, match="ellipsoid"):
        yester.clip_history(image, image, response="ellipsoid", box="minmax")
    for box in HULLS:
        for response in ("clamp", "center"):
            with pytest.raises(ValueError, match='response: expected "current"'):
                yester.clip_history(image, image, box=box, response=response)
    for space in ("rgb", "tonemapped-rgb"):
        with pytest.raises(ValueError, match='space: expected "ycocg" or "tonemapped-ycocg"'):
            yester.clip_history(image, image, box="chroma-hull", response="current", space=space)
    with pytest.raises(ValueError, match="color: expected height 4 and width 5"):
        yester.clip_history(image, image[1:])
    with pytest.raises(ValueError, match="history"):
        yester.clip_history(image[..., 0], image)


@each("case", CASES)
@each("scale", [2.0**-20, 2.0**20])
def test_radiance_has_no_scale(case, scale):
    """Colours and exposure scaled together are clipped alike."""
    box, response, space = case
    named = {"box": box, "response": response, "space": space}
    history, color = images(np.random.default_rng(4), 12, 14)
    scaled = yester.clip_history(history * np.float32(scale), color * np.float32(scale), exposure=scale, **named)
    np.testing.assert_allclose(scaled / scale, yester.clip_history(history, color, **named), rtol=1e-5, atol=1e-6)


@each("case", [case for case in CASES if "tonemapped" in case[2]])
def test_tone_mapped_boxes_do_not_brighten(case):
    """Their corners lie outside the range of the tone curve, where its inverse is undefined."""
    box, response, space = case
    rng = np.random.default_rng(6)
    color = rng.exponential(200, (20, 24, 3)).astype(np.float32)
    history = color * rng.choice([0.01, 1, 3], color.shape).astype(np.float32)
    got = yester.clip_history(history, color, box=box, response=response, space=space, gamma=1.5)
    assert got.max() <= np.float32(max(color.max(), history.max()) * (1 + 1e-5))
    wide = np.pad(color.max(-1), 1, mode="edge")
    around = np.max([wide[y : y + 20, x : x + 24] for y in range(3) for x in range(3)], 0)
    assert (got.max(-1) <= np.maximum(around, history.max(-1)) * (1 + 1e-3)).all()
