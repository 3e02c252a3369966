"""The resolution: as high as the rate allows."""

from __future__ import annotations

__all__ = ["Adaptation"]

#: Sides of the images, relative to the largest.
_SCALES = (1, 3 / 4, 1 / 2, 3 / 8, 1 / 4, 3 / 16, 1 / 8)
#: Images have at least this many pixels on their shorter side.
_LEAST = 60
#: The number of pixels to begin with.
_START = 320 * 240
#: Frames at a new size that are not measured, as some are compiled, and over how many the time is averaged.
_SKIPPED, _MEASURED = 2, 6


class Adaptation:
    """Chooses among sizes of the same shape by the time that frames take, which is about proportional to their pixels.

    Parameters
    ----------
    largest : (int, int)
        Width and height.
    rate : float
        Frames a second to keep.
    adapt : bool, default True
        If False, the size stays the largest.
    """

    def __init__(self, largest: tuple[int, int], rate: float, *, adapt: bool = True) -> None:
        width, height = largest
        scales = [scale for scale in _SCALES if scale == 1 or min(width, height) * scale >= _LEAST]
        self.all = [(round(width * scale), round(height * scale)) for scale in scales]
        self.adapts = adapt
        small = [level for level, (w, h) in enumerate(self.all) if w * h <= _START]
        self.level = (small[0] if small else len(self.all) - 1) if adapt else 0
        self._target = 1e3 / rate
        self._times: list[float] = []

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.all[self.level]

    def fix(self, level: int | None) -> None:
        """Keep a size, by its index in `all`; or with None, adapt it."""
        self.adapts = level is None
        self._move(self.level if level is None else level)

    def note(self, period: float, *, resting: bool, fixed: bool) -> bool:
        """Take the time of a frame in milliseconds, and tell whether the size changes by it.

        While the picture rests, its samples add up, and while it is recorded, its size is fixed: then it stays.
        """
        if not self.adapts or resting or fixed:
            self._times.clear()
            return False
        self._times.append(period)
        measured = self._times[_SKIPPED:]
        if len(measured) < _MEASURED:
            return False
        # The median: other programs interrupt single frames.
        time = sorted(measured)[len(measured) // 2]
        del self._times[_SKIPPED]
        pixels = [w * h for w, h in self.all]
        fitting = [level for level, count in enumerate(pixels) if time * count / pixels[self.level] <= self._target]
        best = fitting[0] if fitting else len(self.all) - 1
        # One step up at a time, and only where there is room: smaller images cost more for each pixel.
        if best < self.level:
            room = time * pixels[self.level - 1] / pixels[self.level] <= 0.8 * self._target
            best = self.level - 1 if room else self.level
        if best == self.level:
            return False
        self._move(best)
        return True

    def _move(self, level: int) -> None:
        self.level = level
        self._times.clear()
