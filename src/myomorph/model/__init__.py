"""The nouns: a model, time series, spatial values and errors. Reads no file, knows no Numba."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
