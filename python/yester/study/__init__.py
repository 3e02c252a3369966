"""Measurements: scenes, comparisons, benchmarks and the demo.

Of the library, only the command line and `yester.live` import this package: the latter for the demo's scene and the
colours of the report.

`synthetic` ray-casts small scenes with exact references; `rendered` renders sequences with Mitsuba and caches them;
`compare` measures methods, components and buffers against references; `speed` times kernels and pipelines.
"""

from yester.judge import predictive_error

__all__ = ["predictive_error"]
