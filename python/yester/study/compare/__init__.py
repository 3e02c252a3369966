"""Accuracy and time of methods, components and buffers, measured against references."""
