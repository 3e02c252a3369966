"""Measurements: scenes, comparisons, benchmarks and the demo. No other module of the library imports this package.

`synthetic` ray-casts small scenes with exact references; `rendered` renders sequences with Mitsuba and caches them;
`compare` measures methods, components and buffers against references; `speed` times kernels and pipelines.
"""

from yester.judge import predictive_error

__all__ = ["predictive_error"]
