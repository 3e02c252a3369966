import torch
from torch import Tensor


def jitter(count: int, *, sequence="halton") -> Tensor:
    """Sample offsets from the pixel centre: "halton" and "r2" by their formulas, the grids by exhaustive search.

    Sources: Halton and Smith 1964; Roberts 2018.

    Parameters
    ----------
    count : number of offsets
    sequence : "halton", "r2", "rotated-grid" or "blue-noise"

    Returns
    -------
    offsets : (count, 2)
    """
    number = torch.arange(1, count + 1, dtype=torch.float64)  # (N,)
    if sequence == "halton":
        return torch.stack([mirrored(number, 2), mirrored(number, 3)], -1) - 0.5  # (N, 2)
    if sequence == "r2":
        rho = torch.tensor(1.0, dtype=torch.float64)
        for _ in range(60):
            rho = (1 + rho) ** (1 / 3)  # of ρ³ = ρ + 1
        return (0.5 + number[:, None] / torch.stack([rho, rho**2])) % 1 - 0.5  # (N, 2)
    column = torch.arange(count)  # (N,)
    rows = [column * a % count for a in range(1, count // 2 + 1)]  # each (N,)
    grids = [torch.stack([column, row], -1) for row in rows if len(row.unique()) == count]  # each (N, 2)
    if count == 4:
        grids = [torch.tensor([[0, 2], [1, 0], [2, 3], [3, 1]])]
    if count == 1:
        grids = [torch.zeros(1, 2)]
    grid = max(grids, key=lambda grid: apart(grid, grid[:1], count)[1:].min() if count > 1 else 0)  # (N, 2)
    if sequence == "blue-noise":
        order = [0]
        while len(order) < count:
            far = torch.stack([apart(grid, grid[i : i + 1], count) for i in order]).amin(0)  # (N,)
            order.append(int(far.argmax()))  # the first of equals; integers are equal exactly
        grid = grid[order]  # (N, 2)
    return (grid.double() + 0.5) / count - 0.5  # (N, 2)


def mirrored(number: Tensor, base: int) -> Tensor:
    """The radical inverse: digits mirrored at the point."""
    place, sum_ = 1.0, torch.zeros_like(number)  # (N,)
    while (number > 0).any():
        place /= base
        sum_ += place * (number % base)  # (N,)
        number = number // base  # (N,)
    return sum_


def apart(points: Tensor, other: Tensor, count: int) -> Tensor:
    """Squared distances (N,), in cells, on the torus."""
    d = (points - other).abs()  # (N, 2)
    return (d.minimum(count - d) ** 2).sum(-1)
