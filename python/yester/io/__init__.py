"""Frames from and to files and renderers; every buffer is made canonical at the door, once."""

from .exr import (
    Description,
    Plate,
    describe,
    read_exr,
    read_plate,
    read_sequence,
    sequence_paths,
    write_exr,
    write_sequence,
)

__all__ = [
    "Description",
    "Plate",
    "describe",
    "read_exr",
    "read_plate",
    "read_sequence",
    "sequence_paths",
    "write_exr",
    "write_sequence",
]
