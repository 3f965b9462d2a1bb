"""The in-vitro experiment: a limb on a force plate, the viscosity of its joint and muscles.

From the bottom: `specimen` cuts base, joint and limb out of a model, `swings` holds recordings as
linear equations, `tracking` makes these from markers and plate, `identification` solves them,
`trust` judges the result. Files and runs are in `study`, the page in `report`; `relaxed` has living
limbs, which no plate weighs. Nothing here knows subjects or trials of other studies.
"""

from myomorph.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
