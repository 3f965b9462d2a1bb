"""Points that share a joint's force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.study.inputs.input import Input, later
from myomorph.study.inputs.keys import WordOrFile


@dataclass(frozen=True)
class ContactPointsFile:
    """Where joints touch.

    Attributes
    ----------
    contact_points : share a joint's force among contact points (joint_contact_forces.sto): auto (medial and lateral
        point of every knee, from the femur's mesh beside the model), a folder with the bones' meshes, or a file of
        points (.toml)
    """

    contact_points: Annotated[str, WordOrFile(option_of="tension")] = ""


INPUT = Input(
    name="contact points",
    settings=ContactPointsFile,
    open=later("myomorph.study.inputs.contact_points_file:opened"),
    main="contact_points",
)
