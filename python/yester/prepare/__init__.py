"""Training sets: what earlier frames tell about each frame of many rendered sequences, computed once and stored."""

from .buffers import CHANNELS, derive, halve
from .run import Prepared, prepare
from .sources import Source, find_sequences

__all__ = ["CHANNELS", "Prepared", "Source", "derive", "find_sequences", "halve", "prepare"]
