"""The resolution: as high as the rate allows."""

from __future__ import annotations

__all__ = ["Adaptation"]

#: Sides of the images, relative to the largest.
_SCALES = (1, 3 / 4, 1 / 2, 3 / 8, 1 / 4, 3 / 16, 1 / 8)
#: Images have at least this many pixels on their shorter side.
_LEAST = 60
#: The number of pixels to begin with.
_START = 320 * 240
#: Frames at a new size that are not measured, as kernels may be compiled for it.
_SKIPPED = 2
#: Frames that are measured before the size falls, and before it grows, which discards history for less.
_DOWN, _UP = 6, 20
#: The share of the time that a larger image may take by prediction.
_ROOM = 0.85


class Adaptation:
    """Chooses among sizes of the same shape by the time that frames take.

    The time is taken for a constant and a part that grows with the pixels, known from the size before; at first, for
    proportional to the pixels.

    Parameters
    ----------
    largest : (int, int)
        Width and height.
    rate : float
        Frames a second to keep.
    adapt : bool, default True
        If False, the size stays the largest.

    Attributes
    ----------
    all : list of (int, int)
        The sizes, from the largest on.
    level : int
        Index of the size.
    adapts : bool
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
        self._left: tuple[int, float] | None = None

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
        # The median: other programs interrupt single frames.
        time = sorted(measured)[len(measured) // 2] if measured else 0.0
        if len(measured) >= _DOWN and time > self._target:
            fitting = [
                level for level in range(self.level, len(self.all)) if self._expected(level, time) <= self._target
            ]
            # Smaller images that are hardly faster are not worth it.
            best = fitting[0] if fitting else self.level
            if not fitting and self._expected(self.level + 1, time) <= 0.9 * time:
                best = len(self.all) - 1
            return self._move(best, time)
        if len(measured) >= _UP:
            room = self.level > 0 and self._expected(self.level - 1, time) <= _ROOM * self._target
            return self._move(self.level - 1 if room else self.level, time)
        return False

    def _expected(self, level: int, time: float) -> float:
        """The time at another level, given that at the current one."""
        here, there = self._pixels(self.level), self._pixels(min(level, len(self.all) - 1))
        slope = time / here
        if self._left is not None and self._left[0] != self.level:
            other, before = self._pixels(self._left[0]), self._left[1]
            slope = min(max((before - time) / (other - here), 0.0), slope)
        return time + slope * (there - here)

    def _pixels(self, level: int) -> int:
        width, height = self.all[level]
        return width * height

    def _move(self, level: int, time: float | None = None) -> bool:
        moves = level != self.level
        if moves or time is None:
            self._left = None if time is None else (self.level, time)
        self.level = level
        self._times.clear()
        return moves
