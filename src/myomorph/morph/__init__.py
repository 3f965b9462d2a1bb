"""Bones and skins: registration, and what moves from one shape to another. Knows nothing of time."""
