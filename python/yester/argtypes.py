"""Types of command-line arguments, for `argparse`."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path

__all__ = ["count", "extent", "filename", "whole"]


def whole(text: str, least: int = 0) -> int:
    """A whole number of at least 0, or another lower bound."""
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise ArgumentTypeError(f"expected a whole number of at least {least}, got {text}")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    return whole(text, 1)


def extent(text: str) -> tuple[int, int]:
    """Width and height, such as 320x240."""
    try:
        width, height = map(count, text.lower().split("x"))
    except (ValueError, ArgumentTypeError):
        raise ArgumentTypeError(f"expected a size like 320x240, got {text}") from None
    return width, height


def filename(text: str) -> Path:
    """A name of a file or folder."""
    if not text:  # such as that of a variable that is not set; it would be the current folder
        raise ArgumentTypeError("expected a name, got an empty one")
    return Path(text)
