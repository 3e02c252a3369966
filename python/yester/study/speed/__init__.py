"""Benchmarks of kernels and pipelines, compared with other libraries and with the machine's limits."""
