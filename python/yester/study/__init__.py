"""Measurements: metrics, scenes, benchmarks and the demo. The library proper does not import it."""
