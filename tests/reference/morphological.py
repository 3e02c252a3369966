import torch
from torch import Tensor
from torch.nn.functional import pad


def morphological_aa(color: Tensor, *, threshold=0.1, max_length=16) -> Tensor:
    """Straighten jagged edges.

    Source: Reshetov 2009, Morphological Antialiasing; lines end where the brighter side changes, and a pixel is blended
    along the direction of its largest coverage.

    Parameters
    ----------
    color : (H, W, 3)
    threshold : difference of brightness above which there is an edge
    max_length : boundaries searched to each side

    Returns
    -------
    color : (H, W, 3)
    """
    light = brightness(color)  # (H, W)
    up, down = shares(light, threshold, max_length)  # (H, W) each
    left, right = (share.T for share in shares(light.T, threshold, max_length))  # (H, W) each
    rows, columns = up.maximum(down), left.maximum(right)  # (H, W)
    # Different ones differ by more than one in (8·257)².
    equal = (rows - columns).abs() < 1e-7  # (H, W)
    weight = torch.where(equal, 0.5, (rows > columns).to(rows))  # (H, W)
    share = torch.stack([weight * up, weight * down, (1 - weight) * left, (1 - weight) * right])  # (4, H, W)
    around = pad(color.movedim(-1, 0), (1, 1, 1, 1))  # (3, H + 2, W + 2)
    neighbors = [around[:, :-2, 1:-1], around[:, 2:, 1:-1], around[:, 1:-1, :-2], around[:, 1:-1, 2:]]  # (3, H, W) each
    offset = torch.stack(neighbors).movedim(1, -1) - color  # (4, H, W, 3)
    step = torch.where(share[..., None] > 0, share[..., None] * offset, 0)  # (4, H, W, 3)
    return torch.where((share > 0).any(0)[..., None], color + step.sum(0), color)


def brightness(color: Tensor) -> Tensor:
    """Perceived brightness in [0, 1]; NaN where missing."""
    light = (color @ color.new_tensor([0.2126, 0.7152, 0.0722])).clamp(min=0)  # (H, W)
    return (light / (1 + light)).sqrt().where(color.isfinite().all(-1), torch.nan)


def edges(light: Tensor, threshold: float) -> Tensor:
    """The sign (H - 1, W) of the difference from each row to the next, where it exceeds the threshold."""
    drop = light[:-1] - light[1:]  # (H - 1, W)
    return drop.sign().where(drop.abs() > threshold, 0)


def shares(light: Tensor, threshold: float, max_length: int) -> tuple[Tensor, Tensor]:
    """Coverage of pixels by their neighbours, below and above the lines between rows, (H, W) each."""
    line = edges(light, threshold)  # (H - 1, W)
    height, width = line.shape
    if height == 0:
        return torch.zeros_like(light), torch.zeros_like(light)
    # Runs of one sign, from the first boundary to that after the last, all rows in one list.
    first = pad(line[:, 1:] != line[:, :-1], (1, 0), value=True).flatten()  # (H - 1)·W
    run = first.cumsum(0) - 1  # (H - 1)·W
    starts = first.nonzero()[:, 0]  # (R,)
    column = torch.arange(height * width) % width  # (H - 1)·W
    start = column[starts][run]  # (H - 1)·W
    end = start + run.bincount()[run]  # (H - 1)·W
    before, after = column - start, end - 1 - column  # (H - 1)·W
    reach = [distance.clamp(max=max_length) for distance in (before, after)]  # (H - 1)·W each
    length = (reach[0] + 1 + reach[1]).to(light)  # (H - 1)·W

    crossings = pad(edges(light.T, threshold).T != 0, (1, 1))  # (H, W + 1): left of each column, and the image's ends
    upper, lower = crossings[:-1], crossings[1:]  # (H - 1, W + 1)
    row = torch.arange(height).repeat_interleave(width)  # (H - 1)·W
    above, below = torch.zeros_like(light[1:]), torch.zeros_like(light[1:])  # (H - 1, W)
    for distance, corner in ((before, start), (after, end)):
        seen = (line.flatten() != 0) & (distance < max_length)  # (H - 1)·W
        area = antiderivative(distance + 1, length) - antiderivative(distance, length)  # (H - 1)·W
        high, low = upper[row, corner], lower[row, corner]  # (H - 1)·W
        above += (area * (seen & high & ~low)).view(height, width)
        below += (area * (seen & low & ~high)).view(height, width)
    return pad(below, (0, 0, 1, 0)), pad(above, (0, 0, 0, 1))


def antiderivative(t: Tensor, length: Tensor) -> Tensor:
    """Antiderivative of the edge's height, which falls from 1/2 at t = 0 to 0 in the middle of the line."""
    t = (length / 2).minimum(t)
    return t / 2 - t**2 / (2 * length)
