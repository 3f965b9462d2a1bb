"""Estimates: unknowns, residuals, one solver, one posterior, one verdict. Knows arrays only."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
