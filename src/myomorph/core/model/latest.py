"""Results of the last few models, so that steps ask for them freely."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Generic, TypeVar

from myomorph.core.model.model import Model

Made = TypeVar("Made")


class Latest(Generic[Made]):
    """A function of a model whose last few results are stored.

    Parameters
    ----------
    make : the function
    kept : number of results
    """

    def __init__(self, make: Callable[[Model], Made], kept: int = 8):
        self._make = make
        self._kept = kept
        self._made: OrderedDict[Model, Made] = OrderedDict()
        self._lock = Lock()

    def __call__(self, model: Model) -> Made:
        """Compute the function, or look its result up."""
        with self._lock:
            if model in self._made:
                self._made.move_to_end(model)
                return self._made[model]
        made = self._make(model)
        self.put(model, made)
        return made

    def put(self, model: Model, made: Made) -> None:
        """Store a result that was computed in another way."""
        with self._lock:
            self._made[model] = made
            self._made.move_to_end(model)
            while len(self._made) > self._kept:
                self._made.popitem(last=False)
