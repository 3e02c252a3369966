"""Pictures as messages: a header in JSON, and the pixels of two images as they are.

WebP was measured and is slower here: see `yester.study.speed.live`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["packed"]


def packed(header: Mapping[str, Any], images: Sequence[memoryview]) -> bytes:
    """Four bytes (little-endian) with the length of the header; the header; the RGBA bytes of each image."""
    text = json.dumps(header).encode()
    return b"".join([len(text).to_bytes(4, "little"), text, *images])
