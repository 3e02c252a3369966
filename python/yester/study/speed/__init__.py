"""Benchmarks of kernels and pipelines beside other libraries and the limits of the machine."""
