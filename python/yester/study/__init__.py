"""Measurements: scenes, comparisons, benchmarks and the demo. The library proper does not import it.

`synthetic` ray-casts small scenes whose truth is known exactly; `rendered` has Mitsuba render sequences and keeps them;
`compare` measures methods, components and buffers against references; `speed` times kernels and pipelines.
"""

from yester.judge import predictive_error

__all__ = ["predictive_error"]
