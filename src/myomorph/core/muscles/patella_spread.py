"""How much the places of patellae differ between people, as far as models cannot know."""

from __future__ import annotations

DISTANCE_SD = 0.005
"""Of a person's patellae from the knees' axes, alike in both knees [m]: with `TRACK_SD` as far as
arms of the patellar tendon differ between people and ways to measure them
(`core.muscles.published_arms`).
"""
TRACK_SD = 0.004  # Of a patella on its thigh along each axis [m] (Krevolin et al. 2004)
