"""The tests that history fails, and the colours in which images show them."""

from __future__ import annotations

from enum import IntFlag

__all__ = ["Rejection"]


class Rejection(IntFlag):
    """The tests that a pixel's history failed: bits of the masks of `consistency` and `Output.rejection`.

    Attributes
    ----------
    OUTSIDE
        1: the history lies outside the previous frame.
    DEPTH
        2: it has another depth than expected.
    NORMAL
        4: it has another orientation.
    ID
        8: it is another object.
    VELOCITY
        16: the motion is longer than allowed.
    LUMINANCE
        32: it has another brightness.
    MOTION
        64: it moved in another way.

    See Also
    --------
    consistency : The tests.
    Output : Its `rejection` has these bits.

    Examples
    --------
    >>> rejection = np.array([[0, 2], [6, 1]], np.uint8)
    >>> yester.Rejection(int(rejection[1, 0]))
    <Rejection.DEPTH|NORMAL: 6>
    >>> rejection & yester.Rejection.DEPTH != 0
    array([[False,  True],
           [ True, False]])
    """

    OUTSIDE = 1
    """The history lies outside the previous frame."""
    DEPTH = 2
    """It has another depth than expected."""
    NORMAL = 4
    """It has another orientation."""
    ID = 8
    """It is another object."""
    VELOCITY = 16
    """The motion is longer than allowed."""
    LUMINANCE = 32
    """It has another brightness."""
    MOTION = 64
    """It moved in another way."""


#: The colour of each test in reports and on the live page.
COLORS = dict(
    zip(Rejection, ("#4dabf7", "#ffd43b", "#69db7c", "#f783ac", "#ff922b", "#ffffff", "#b197fc"), strict=True)
)
