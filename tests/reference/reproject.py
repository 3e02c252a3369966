import torch
from torch import Tensor

from .surface import Footprint, SurfaceTests


def catmull_rom(x: Tensor) -> Tensor:
    x = x.abs()  # (P,)
    near, far = 1.5 * x**3 - 2.5 * x**2 + 1, -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2  # (P,)
    return torch.where(x < 1, near, torch.where(x < 2, far, 0))


def lanczos2(x: Tensor) -> Tensor:
    return torch.where(x.abs() < 2, torch.sinc(x) * torch.sinc(x / 2), 0)  # (P,)


KERNELS = {"catmull-rom": catmull_rom, "catmull-rom-5": catmull_rom, "lanczos-2": lanczos2}


def reproject(history, motion: Tensor, *, filter="bilinear", fallback=True, dering=True, margin=False, **surface):
    """Fetch history along motion, from the taps that show the same surface.

    S = Σ w·trust; where S ≥ 0.01 the value is Σ w·trust·h / S, else the same over 3x3 with w = 1/9, else 0. The wide
    filters replace the value, with their own weights, where every tap of nonzero weight has nonzero trust.
    Sources: Schied et al. 2017, section 4.1; Falcor's SVGF pass; Keys 1981 (a = -1/2); Duchon 1979 (Lanczos).

    Parameters
    ----------
    history : (H, W, C) or (H, W), or a list of such
    motion : (H, W, 2) or (H, W, 3)
    filter : "nearest", "bilinear", "catmull-rom", "catmull-rom-5" (without the corners) or "lanczos-2"
    dering : clamp the wide filters to the range of the bilinear taps
    margin : also return the distance (H, W) of the nearest decision from its threshold, and the factor (H, W) by which
        ramps multiply roundings
    **surface : see `surface.SurfaceTests`

    Returns
    -------
    values : like history
    coverage : (H, W)
    """
    images = list(history) if isinstance(history, list | tuple) else [history]
    height, width = motion.shape[:2]
    stack = torch.cat([image.reshape(height * width, -1) for image in images], -1)  # (P, C)
    finite = stack.isfinite().all(-1)  # (P,)
    stack = stack.where(finite[:, None], 0)  # (P, C)
    footprint = Footprint(motion)
    tests = SurfaceTests(motion, footprint, **surface)
    nearest = torch.full((height * width,), torch.inf, dtype=stack.dtype, device=stack.device)  # (P,)
    steepness = torch.zeros_like(nearest)  # (P,)

    def look(pixel: Tensor, x: Tensor, y: Tensor, looking: Tensor) -> tuple[Tensor, Tensor]:
        """The trust (N,) in taps, and their values (N, C)."""
        tap, inside = footprint.flat(x, y)  # (N,)
        trust = (looking & inside & finite[tap]).to(stack.dtype)  # (N,)
        for test in tests(pixel, x, y).values():
            if margin:
                counts = trust > 0  # (N,)
                nearest[pixel] = torch.where(counts, nearest[pixel].minimum(test.slack.abs()), nearest[pixel])
                steepness[pixel] = torch.where(counts, steepness[pixel].maximum(test.steepness), steepness[pixel])
            trust = trust * test.trust  # (N,)
        return trust, stack[tap]

    pixel = everyone = torch.arange(height * width, device=motion.device)  # (P,)
    total = torch.zeros_like(stack)  # (P, C)
    share = torch.zeros_like(stack[:, 0])  # (P,)
    if filter == "nearest":
        taps = [(*footprint.nearest(), footprint.moving.to(stack.dtype))]
    else:
        taps = list(footprint.bilinear())
    for x, y, weight in taps:
        trust, values = look(pixel, x, y, weight > 0)  # (P,), (P, C)
        total += values * (weight * trust)[:, None]  # (P, C)
        share += weight * trust  # (P,)
    share = share.clamp(max=1)  # (P,)
    if margin:
        nearest = nearest.minimum((share - 0.01).abs() / steepness.clamp(min=1))  # (P,)

    good = share >= 0.01  # (P,)
    out = torch.where(good[:, None], total / share[:, None], 0)  # (P, C)
    coverage = torch.where(good, share, 0)  # (P,)
    if fallback:
        (pixel,) = (~good & footprint.moving).nonzero(as_tuple=True)  # (N,)
        x, y = (centre[pixel] for centre in footprint.nearest())  # (N,)
        total = torch.zeros_like(stack[pixel])  # (N, C)
        count = torch.zeros_like(share[pixel])  # (N,)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                trust, values = look(pixel, x + dx, y + dy, torch.ones_like(x, dtype=torch.bool))  # (N,), (N, C)
                total += values * trust[:, None]  # (N, C)
                count += trust  # (N,)
        out[pixel] = torch.where(count[:, None] > 0, total / count[:, None], 0)  # (N, C)
        coverage[pixel] = count / 9  # (N,)

    if filter in KERNELS:
        kernel = KERNELS[filter]
        x0, y0 = footprint.x.floor(), footprint.y.floor()  # (P,)
        fx, fy = (footprint.x - x0).to(stack.dtype), (footprint.y - y0).to(stack.dtype)  # (P,)
        wide = footprint.moving.clone()  # (P,)
        total, weights = torch.zeros_like(out), torch.zeros_like(share)  # (P, C), (P,)
        low, high = torch.full_like(out, torch.inf), torch.full_like(out, -torch.inf)  # (P, C)
        for dy in (-1, 0, 1, 2):
            for dx in (-1, 0, 1, 2):
                if filter == "catmull-rom-5" and dx in (-1, 2) and dy in (-1, 2):
                    continue
                wx, wy = kernel(fx - dx), kernel(fy - dy)  # (P,), (P,)
                # Exactly zero at whole distances, where sin(k·π) is not.
                weight = (wx * wy).where(((fx != 0) | (dx == 0)) & ((fy != 0) | (dy == 0)), 0)  # (P,)
                counts = weight != 0  # (P,)
                trust, values = look(
                    everyone,
                    footprint._index(x0, footprint.width) + dx,
                    footprint._index(y0, footprint.height) + dy,
                    counts,
                )  # (P,), (P, C)
                fails = counts & (trust == 0)  # (P,)
                wide = wide & ~fails  # (P,)
                # A weight near zero may be zero in another precision.
                nearest = torch.where(fails, nearest.minimum(10 * wx.abs().minimum(wy.abs())), nearest)  # (P,)
                total, weights = total + values * weight[:, None], weights + weight  # (P, C), (P,)
                inner = counts & (dx in (0, 1)) & (dy in (0, 1))  # (P,)
                low = torch.where(inner[:, None], low.minimum(values), low)  # (P, C)
                high = torch.where(inner[:, None], high.maximum(values), high)  # (P, C)
        total = total / weights[:, None]  # (P, C)
        if dering:
            total = total.clamp(low, high)  # (P, C)
        out = torch.where(wide[:, None], total, out)  # (P, C)
        coverage = torch.where(wide, share, coverage)  # (P,)

    split = out.split([image.numel() // (height * width) for image in images], -1)  # each (P, c)
    values = [part.reshape(image.shape) for part, image in zip(split, images, strict=True)]
    planes = [coverage, *([nearest, steepness] if margin else [])]  # each (P,)
    values = values if isinstance(history, list | tuple) else values[0]
    return (values, *(plane.reshape(height, width) for plane in planes))
