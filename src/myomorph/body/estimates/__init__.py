"""Values that estimates of a body are made of, as its functions return them."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
