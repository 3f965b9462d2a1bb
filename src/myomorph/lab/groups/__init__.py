"""Two groups of subjects, or two conditions of the same, compared over strides."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
