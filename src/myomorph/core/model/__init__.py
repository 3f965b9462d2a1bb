"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
