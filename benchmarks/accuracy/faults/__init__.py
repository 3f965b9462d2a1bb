"""Faults of recordings: found, named, repaired."""
