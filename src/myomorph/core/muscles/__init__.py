"""Muscle paths, moment arms and Hill-type curves. Solves nothing."""
