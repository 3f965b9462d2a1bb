"""Kinds of movement that a recording is of."""

from __future__ import annotations

from typing import Literal, get_args

Movement = Literal[
    "standing",
    "walking",
    "running",
    "jumping",
    "squatting",
    "rising",
    "stairs",
    "upper limb",
    "other",
]
MOVEMENTS: tuple[Movement, ...] = get_args(Movement)
"""All of them; "rising" is from a seat, "other" one that none of these words names."""
