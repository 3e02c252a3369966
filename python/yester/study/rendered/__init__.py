"""Sequences that Mitsuba renders, and their recordings on disk."""
