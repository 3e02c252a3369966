"""Measurements: metrics, scenes, benchmarks and the demo. The library proper does not import it."""

from yester.judge import predictive_error

__all__ = ["predictive_error"]
