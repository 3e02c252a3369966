"""Sequences rendered by Mitsuba, and their recordings on disk."""
