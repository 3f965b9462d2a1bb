"""Force plates: what a recording holds of them, as forces on the bodies that stand on them."""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
