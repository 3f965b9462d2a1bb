"""What a user tells of the subject's body, and how its mass is laid out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

WEIGHTS = ("bone", "cog", "nearest")


@dataclass(frozen=True)
class BodyOptions:
    """How the mass of a body is laid out before it is identified.

    Attributes
    ----------
    spacing : of the grid of mass points [m]
    weights : which links a mass point belongs to: by its distance to the bones, to the links' mass centers ([D] eq.
        3.14), or to the nearest mass center only (3.15); by default to the bones in a skin, and each link's own
        points where only its envelope is known
    density : inside a skin, the same everywhere ([D]), or that of each segment, the trunk light with its lungs
        (Dempster 1955)
    """

    spacing: float = 0.005
    weights: Literal["bone", "cog", "nearest"] | None = None
    density: Literal["even", "segments"] = "even"


@dataclass(frozen=True)
class BodyShape:
    """What is known of the subject's shape; nothing means envelopes of the model's own bodies.

    Attributes
    ----------
    skin : mesh file
    landmarks : table of markers on the skin (CSV: name, x, y, z), to pose the model in it
    height, chest : of the subject [m]
    sex : "female" or "male"
    age : [years]
    """

    skin: Path | None = None
    landmarks: Path | None = None
    height: float | None = None
    chest: float | None = None
    sex: Literal["female", "male"] | None = None
    age: float | None = None
