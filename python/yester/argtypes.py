"""Types of command-line arguments, for `argparse`."""

from __future__ import annotations

from argparse import ArgumentTypeError

__all__ = ["count", "extent", "whole"]


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
