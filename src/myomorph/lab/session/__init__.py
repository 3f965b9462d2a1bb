"""Who was recorded, when, and in which movement: the session of a folder of recordings.

Here live what raw recordings hold, who they are of, and which movement each is; never a study that
follows from them.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
