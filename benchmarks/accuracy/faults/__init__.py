"""Faults of recordings: found, named, mended."""
