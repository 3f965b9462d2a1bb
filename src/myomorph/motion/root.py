"""The coordinates by which a body floats in the laboratory, whose bounds say nothing about the body."""

from __future__ import annotations

from collections.abc import Iterator

from myomorph.model.model import GROUND, Joint, Model

MASSLESS = 1e-6
"""A body lighter than this share of the whole is a link on the way from the ground."""


def floating_coordinates(model: Model) -> tuple[str, ...]:
    """Coordinates of the joints that let a body float: at least two translations and one rotation against the ground.

    A joint to the ground that only turns (an arm fixed at the shoulder) or only slides (a sled) is part of the
    body or of a rig, and its bounds count. Massless links between ground and body belong to the root joint.
    """
    found: list[str] = []
    for chain in _root_chains(model):
        axes = [(axis.kind, name) for joint in chain for axis in joint.axes for name in axis.coordinates]
        turns = {name for kind, name in axes if kind == "rotation"}
        # Old files call the translations of a custom joint coupled; a rotation may bring a translation along.
        slides = {name for kind, name in axes if kind == "translation"} - turns
        if len(slides) >= 2 and turns:
            found += dict.fromkeys(name for _, name in axes)
    return tuple(found)


def _root_chains(model: Model) -> Iterator[list[Joint]]:
    """Joints between the ground and each body that hangs on it."""
    light = MASSLESS * max(model.mass, 1e-12)
    for joint in model.joints:
        if joint.parent != GROUND:
            continue
        chain = [joint]
        while model.body(chain[-1].child).mass < light:
            after = [one for one in model.joints if one.parent == chain[-1].child]
            if len(after) != 1:
                break
            chain += after
        yield chain
