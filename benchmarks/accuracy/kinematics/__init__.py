"""Angles, lengths and filters."""
