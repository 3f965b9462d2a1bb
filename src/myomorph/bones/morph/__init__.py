"""Models in other bones: surfaces registered, the space around them mapped, muscles transferred.

Lives here: whatever knows two shapes of a bone or two models of a skeleton. `maps/` and `shapes/`
are the ground floor, `registration/` finds the map of one bone, `transfer/` brings a model through
such maps, `checks/` compares the result with its source, `mirror/` makes the other side, `species/`
pairs two species. `morphed.py` has the options and the result of a transfer. Never here: time,
files, and pages of results.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
