"""Measurements: scenes, comparisons, benchmarks and the demo.

Of the library, only the command line and `yester.live` import this package: the latter for the demo's scene and the
ends of the report's colour maps.

`synthetic` ray-casts small scenes with exact references; `rendered` renders sequences with Mitsuba and caches them;
`compare` measures methods, components and buffers against references; `speed` times kernels and pipelines.
"""
