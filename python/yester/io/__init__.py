"""Read and write frames: files and renderers. Every buffer is converted to its canonical form once, on input."""

from .exr import (
    COMPRESSIONS,
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
    "COMPRESSIONS",
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
