"""Surfaces laid onto surfaces: rigid registration, linear maps, clusters of balls."""
