"""Results to look at: pages that play them, movies, and poses and paths to draw oneself.

No value that is kept is computed here.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
