"""Muscle tensions: terms, actuators and the one convex problem of a frame."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
