"""Finding a muscle by what one types."""

from __future__ import annotations

import re
from collections.abc import Sequence

from myomorph.analysis.selection import MAJOR_MUSCLES, pairs
from myomorph.model.sides import split_side


class MuscleIndex:
    """Muscles of a model under the names that people give them.

    Parameters
    ----------
    names : of the muscles
    prefixes : what the names of a subject begin with, where there are several
    """

    def __init__(self, names: Sequence[str], prefixes: Sequence[str] = ()):
        self.names = tuple(names)
        side_of = {name: side for pair in pairs(names) for side, of in pair.members.items() for name in of}
        self._words = tuple(_words(name, side_of.get(name, ""), prefixes) for name in names)

    def matches(self, text: str) -> tuple[str, ...]:
        """Names that hold every word of a text, in their own or their anatomical name; a whole name stands alone.

        >>> MuscleIndex(["soleus_r", "soleus_l", "bflh_r"]).matches("biceps femoris")
        ('bflh_r',)
        >>> MuscleIndex(["soleus_r", "soleus_l", "bflh_r"]).matches("left sol")
        ('soleus_l',)
        """
        asked = text.strip().lower()
        exact = tuple(name for name in self.names if name.lower() == asked)
        if exact or not asked:
            return exact
        wanted = asked.split()
        return tuple(
            name for name, words in zip(self.names, self._words, strict=True) if all(one in words for one in wanted)
        )


def _words(name: str, side: str, prefixes: Sequence[str]) -> str:
    own = next((name.removeprefix(one) for one in prefixes if one and name.startswith(one)), name)
    base = split_side(own.rsplit("__", 1)[-1])[0]
    told = [label for label, pattern in MAJOR_MUSCLES if re.fullmatch(pattern, base, re.IGNORECASE)]
    return " ".join([name, name.replace("_", " "), side, *told]).lower()
