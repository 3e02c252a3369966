"""The samples of a picture at rest, which add up to a reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Samples"]


class Samples:
    """The mean of a picture's samples, as long as the picture stays what it is.

    Attributes
    ----------
    count : int
        Number of samples per pixel.
    """

    def __init__(self) -> None:
        self.count = 0
        self._shows: object = None
        self._first: NDArray[np.float32] | None = None
        self._total: NDArray[np.float64] | None = None
        self._seen: NDArray[np.float64] | None = None

    def add(self, color: NDArray[np.float32], shows: object) -> None:
        """Add a sample per pixel, those that are finite; begin anew if it shows something else than before."""
        if shows != self._shows:
            self.count, self._shows, self._total = 0, shows, None
        self.count += 1
        if self.count == 1:  # as always in motion: there is nothing to add to
            self._first = color
            return
        if self._total is None:
            self._total, self._seen = np.zeros(color.shape), np.zeros((*color.shape[:2], 1))
            assert self._first is not None
            self._sum(self._first)
        self._sum(color)

    def _sum(self, color: NDArray[np.float32]) -> None:
        assert self._total is not None
        assert self._seen is not None
        here = np.isfinite(color).all(-1, keepdims=True)
        self._total += np.where(here, color, 0)
        self._seen += here

    def mean(self) -> NDArray[np.float32]:
        """The mean, (H, W, 3)."""
        if self._total is None or self._seen is None:
            assert self._first is not None
            return self._first
        return (self._total / np.maximum(self._seen, 1)).astype(np.float32)
