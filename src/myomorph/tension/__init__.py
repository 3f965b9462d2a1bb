"""Muscle tensions: terms, actuators and the one convex problem of a frame."""
