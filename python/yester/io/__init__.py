"""Read and write frames: files and renderers.

Every buffer is converted to its canonical form once, on input. EXR files are read and written here; `yester.io.mitsuba`
renders sequences.
"""

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
