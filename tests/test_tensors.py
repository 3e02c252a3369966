"""Tensors in and out: without copies where the layout allows, and never with gradients that get lost."""

import multiprocessing

import drjit
import flight
import mitsuba as mi
import numpy as np
import pytest
import torch
import yester
from yester import metrics
from yester.mitsuba import Denoiser
from yester.tensors import channels_first, channels_last

SIZE = 24, 32


def test_tensors_share_their_memory():
    color = torch.rand(*SIZE, 3)
    assert yester.Frame(color).color.ctypes.data == color.data_ptr()
    result = yester.demodulate(color, torch.rand(*SIZE, 3))
    assert torch.from_dlpack(result).data_ptr() == result.ctypes.data
    # In the memory format of networks that have channels last, the helper copies nothing, either.
    batch = torch.rand(2, 3, *SIZE).to(memory_format=torch.channels_last)
    moved = channels_last(batch)
    assert moved.shape == (2, *SIZE, 3)
    assert moved.ctypes.data == batch.data_ptr()
    assert yester.Frame(moved[1]).color.ctypes.data == batch[1].data_ptr()
    back = torch.from_dlpack(channels_first(moved))
    assert back.data_ptr() == batch.data_ptr()
    assert torch.equal(back, batch)


def test_other_layouts_are_copied_once():
    batch = torch.rand(2, 3, *SIZE)
    moved = channels_last(batch)
    assert moved.flags.c_contiguous
    np.testing.assert_array_equal(moved, batch.permute(0, 2, 3, 1).numpy())
    view = channels_last(batch, copy=False)
    assert view.ctypes.data == batch.data_ptr()
    np.testing.assert_array_equal(view, moved)
    first = channels_first(moved, copy=True)
    assert first.flags.c_contiguous
    np.testing.assert_array_equal(first, batch.numpy())
    assert channels_last(batch, copy=True).ctypes.data != batch.data_ptr()


@pytest.mark.parametrize("move", [channels_last, channels_first])
def test_a_view_of_a_nested_sequence_is_refused(move):
    """It could only be a copy."""
    nested = [[[1.0, 2.0]]]
    with pytest.raises(ValueError, match="copy: expected True or None for a nested sequence, got False"):
        move(nested, copy=False)
    np.testing.assert_array_equal(move(nested), move(np.array(nested)))
    np.testing.assert_array_equal(move(nested, copy=True), move(np.array(nested)))


def test_single_channels():
    depth = torch.rand(5, 1, *SIZE)
    moved = channels_last(depth)
    assert moved.shape == (5, *SIZE)
    assert moved.ctypes.data == depth.data_ptr()
    assert channels_first(moved, channels=False).shape == (5, 1, *SIZE)
    assert channels_last(np.zeros((2, 4, 3, *SIZE))).shape == (2, 4, *SIZE, 3)


class Exporter:
    """A tensor of a library that has DLPack and nothing else."""

    def __init__(self, tensor):
        self.tensor = tensor

    def __dlpack__(self, **named):
        return self.tensor.__dlpack__(**named)

    def __dlpack_device__(self):
        return self.tensor.__dlpack_device__()


def test_tensors_with_dlpack_alone():
    tensor = torch.rand(3, *SIZE)
    np.testing.assert_array_equal(channels_last(Exporter(tensor)), tensor.permute(1, 2, 0).numpy())
    color, depth = torch.rand(*SIZE, 3), torch.rand(*SIZE, dtype=torch.float64)
    frame = yester.Frame(Exporter(color), depth=Exporter(depth), ids=Exporter(torch.ones(SIZE, dtype=torch.int64)))
    assert frame.color.ctypes.data == color.data_ptr()
    np.testing.assert_array_equal(frame.depth, depth.float().numpy())
    assert (frame.ids == 1).all()
    for wrong, said in (
        (torch.rand(*SIZE, 3, requires_grad=True), "gradient"),
        (torch.ones(*SIZE, 3, dtype=torch.bfloat16), "dtype"),
    ):
        with pytest.raises(TypeError, match=rf"^albedo: expected an array, got Exporter, .*{said}"):
            yester.Frame(color, albedo=Exporter(wrong))
        with pytest.raises(TypeError, match=rf"^images: expected an array, got Exporter, .*{said}"):
            channels_last(Exporter(wrong))
    with pytest.raises(ValueError, match=r"^depth: expected shape \(H, W\)"):
        yester.Frame(color, depth=Exporter(color))


def test_tensors_of_mitsuba():
    color = mi.TensorXf(np.random.default_rng(0).random((*SIZE, 3), np.float32))
    frame = yester.Frame(color, albedo=color)
    assert frame.color.ctypes.data == frame.albedo.ctypes.data == np.from_dlpack(color).ctypes.data
    np.testing.assert_array_equal(frame.color, color.numpy())


@pytest.mark.parametrize(
    "take",
    [
        yester.Frame,
        lambda x: yester.demodulate(x, np.ones((*SIZE, 3))),
        lambda x: yester.exposure(x),
        lambda x: metrics.psnr(x, np.ones((*SIZE, 3))),
        channels_last,
        channels_first,
    ],
)
def test_gradients_are_refused(take, monkeypatch):
    """With a sentence that says what to do; not detached silently."""
    with pytest.raises(TypeError, match=r"expected an array, got a tensor that needs gradients: pass x\.detach\(\)"):
        take(torch.rand(*SIZE, 3, requires_grad=True))
    with pytest.raises(TypeError, match=r"got a tensor that needs gradients"):
        take(torch.rand(*SIZE, 3, requires_grad=True) * 2)
    take(torch.rand(*SIZE, 3, requires_grad=True).detach())
    # Variants with gradients need LLVM, which not every machine has.
    color = mi.TensorXf(np.ones((*SIZE, 3), np.float32))
    take(color)
    monkeypatch.setattr(drjit, "grad_enabled", lambda given: given is color)
    with pytest.raises(TypeError, match=r"expected an array, got a tensor that needs gradients: pass drjit\.detach"):
        take(color)


def test_what_numpy_lacks():
    for take in (channels_last, yester.Frame):
        with pytest.raises(TypeError, match=r"got bfloat16, which numpy does not have: pass x\.float\(\)"):
            take(torch.ones(*SIZE, 3, dtype=torch.bfloat16))
        negative = torch.ones(*SIZE, 3, dtype=torch.complex64).conj().imag
        for lacking, remedy in ((negative, r"tensor\.resolve_neg"), (torch.ones(*SIZE, 3).to_sparse(), r"\.to_dense")):
            with pytest.raises(TypeError, match=rf"^(images|color): expected an array, got Tensor, .*{remedy}"):
                take(lacking)
    for take in (channels_last, channels_first):
        with pytest.raises(ValueError, match="images: expected shape"):
            take(torch.ones(24))


@pytest.mark.parametrize("move", [channels_last, channels_first, lambda x: Denoiser(SIZE[::-1])(x)])
def test_masks_are_refused(move):
    with pytest.raises(TypeError, match=r"^(images|noisy): expected an array without a mask, got a masked one"):
        move(np.ma.masked_array(np.ones((*SIZE, 3), np.float32), True))


class Denoised(torch.utils.data.Dataset):
    """Frames that workers denoise."""

    def __len__(self):
        return 3

    def __getitem__(self, index):
        shot = flight.shoot(index, *SIZE[::-1])
        output = yester.SVGF().step(yester.Frame(torch.from_numpy(shot.color), depth=shot.depth, normal=shot.normal))
        return torch.from_dlpack(channels_first(output.color, copy=True))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_of_a_loader(method, monkeypatch):
    want = [Denoised()[index] for index in range(3)]
    context = multiprocessing.get_context(method)
    loader = torch.utils.data.DataLoader(
        Denoised(), batch_size=3, num_workers=1, timeout=120, multiprocessing_context=context
    )
    (batch,) = loader
    assert torch.equal(batch, torch.stack(want))


# Mitsuba


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def frames(count: int) -> list[yester.Frame]:
    rng = np.random.default_rng(0)
    shots = [flight.shoot(number, *SIZE[::-1]) for number in range(count)]
    named = [{"albedo": shot.albedo, "normal": shot.normal, "motion": shot.motion[..., :2].copy()} for shot in shots]
    return [yester.Frame(flight.noisy(shot, rng), **each) for shot, each in zip(shots, named, strict=True)]


def tensor(array):
    return mi.TensorXf(np.ascontiguousarray(array))


def test_the_denoiser_is_svgf():
    denoiser, svgf = Denoiser(SIZE[::-1], albedo=True, normals=True, temporal=True), yester.SVGF()
    previous = None
    for frame in frames(3):
        noisy = tensor(frame.color)
        given = tensor(frame.albedo), tensor(frame.normal)
        result = denoiser(
            noisy, *given, flow=tensor(-frame.motion), previous_denoised=noisy if previous is None else previous
        )
        assert type(result) is mi.TensorXf
        np.testing.assert_array_equal(np.array(result), svgf.step(frame).color)
        previous = result
    # Anything but the last result begins a new sequence.
    again = denoiser(noisy, *given, flow=tensor(-frame.motion), previous_denoised=noisy)
    np.testing.assert_array_equal(np.array(again), yester.SVGF().step(frame).color)


def test_lists_give_arrays():
    (frame,) = frames(1)
    denoised = Denoiser(SIZE[::-1])(frame.color.tolist())
    np.testing.assert_array_equal(denoised, yester.SVGF().step(yester.Frame(frame.color)).color)
    assert isinstance(denoised, np.ndarray)


def test_without_history_each_image_is_by_itself():
    denoiser = Denoiser(SIZE[::-1])
    for frame in frames(2):
        want = yester.SVGF().step(yester.Frame(frame.color)).color
        np.testing.assert_array_equal(denoiser(frame.color), want)
    other = Denoiser(SIZE[::-1], pipeline=yester.SVGF(iterations=1))
    assert (other(frame.color) != want).any()


@pytest.mark.parametrize("denoised", [False, True])
def test_alpha(denoised):
    (frame,) = frames(1)
    alpha = np.random.default_rng(1).integers(0, 2, SIZE).astype(np.float32)
    denoiser = Denoiser(SIZE[::-1], denoise_alpha=denoised)
    result = np.array(denoiser(tensor(np.dstack([frame.color, alpha]))))
    np.testing.assert_array_equal(result[..., :3], yester.SVGF().step(yester.Frame(frame.color)).color)
    if denoised:
        assert result[..., 3].std() < 0.5 * alpha.std()
        assert abs(result[..., 3].mean() - alpha.mean()) < 0.05
    else:
        np.testing.assert_array_equal(result[..., 3], alpha)


def test_bitmaps_of_a_film():
    scene = mi.cornell_box()
    scene["integrator"] = {"type": "aov", "aovs": "albedo:albedo,nn:sh_normal", "img": {"type": "path"}}
    scene["sensor"]["film"] |= {"width": 32, "height": 24}
    scene = mi.load_dict(scene)
    mi.render(scene, spp=1)
    bitmap = scene.sensors()[0].film().bitmap()
    layers = {name: np.array(layer) for name, layer in bitmap.split()}
    want = yester.SVGF().step(yester.Frame(layers["<root>"], albedo=layers["albedo"], normal=layers["nn"])).color
    denoiser = Denoiser((32, 24), True, True)
    to_sensor = scene.sensors()[0].world_transform().inverse()
    for result in (
        denoiser(bitmap, albedo_ch="albedo", normals_ch="nn", to_sensor=to_sensor),
        denoiser(bitmap, "albedo", "nn", to_sensor),
    ):
        assert type(result) is mi.Bitmap
        np.testing.assert_array_equal(np.array(result), want)
    with pytest.raises(ValueError, match=r"albedo: expected one of the layers <root>, .*, got albdo"):
        denoiser(bitmap, albedo_ch="albdo", normals_ch="nn")
    plain = Denoiser((32, 24))(mi.Bitmap(layers["<root>"]))
    np.testing.assert_array_equal(np.array(plain), yester.SVGF().step(yester.Frame(layers["<root>"])).color)


def test_the_denoiser_refuses():
    one, flow = np.ones((*SIZE, 3), np.float32), np.zeros((*SIZE, 2), np.float32)
    with pytest.raises(ValueError, match="albedo: expected one, as the denoiser was made for it"):
        Denoiser(SIZE[::-1], albedo=True)(one)
    with pytest.raises(ValueError, match="flow: expected none from a denoiser that was made without temporal=True"):
        Denoiser(SIZE[::-1])(one, flow=flow)
    with pytest.raises(ValueError, match=r"noisy: expected shape \(24, 32, 3\) or \(24, 32, 4\), got \(24, 31, 3\)"):
        Denoiser(SIZE[::-1])(one[:, 1:])
    with pytest.raises(ValueError, match="input_size: expected at least 1 x 1, got 0 x 4"):
        Denoiser((0, 4))


def test_it_has_the_parameters_of_mitsubas_denoiser():
    """By the names that Mitsuba documents."""
    for method, ours in (
        (mi.OptixDenoiser.__init__, Denoiser.__init__),
        (mi.OptixDenoiser.__call__, Denoiser.__call__),
    ):
        theirs = {
            word.strip("`:")
            for line in method.__doc__.splitlines()
            if line.startswith("Parameter ")
            for word in [line[10:]]
        }
        assert len(theirs) >= 5
        assert theirs <= {*ours.__code__.co_varnames}
