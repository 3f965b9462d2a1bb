"""Pages that play: stored results in three dimensions, and live ones.

They show values and compute none that is kept.
"""
