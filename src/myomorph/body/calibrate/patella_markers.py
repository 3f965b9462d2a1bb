"""Markers on patellae: which they are, and that they follow the patella instead of the thigh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from myomorph.core.model.causes import MARKERS
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Marker, Model
from myomorph.core.motion.protocols import recognize
from myomorph.core.muscles.patella import patella_of
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.rigid.knees import knee_joints

SITE = "thigh.patella"
"""What protocols call the place."""


def guided_patellae(model: Model) -> Mapping[str, str]:
    """Find the patellae that follow the angle of their knee alone.

    Parameters
    ----------
    model : of any body

    Returns
    -------
    patella by the thigh that it hangs on; none that has a coordinate of its own
    """
    driven = set(model.dependent_coordinates)
    locked = {coordinate.name for coordinate in model.coordinates if coordinate.locked}
    joints = {joint.child: joint for joint in model.joints}
    found = {}
    for knee in knee_joints(model):
        patella = patella_of(model, knee)
        if patella is not None and set(joints[patella].coordinates) <= driven | locked:
            found[knee.parent] = patella
    return FrozenMap(found)


def markers_on_patellae(model: Model) -> Mapping[str, str]:
    """Find the markers of a model that are on patellae.

    Parameters
    ----------
    model : with markers

    Returns
    -------
    patella by marker
    """
    patellae = set(guided_patellae(model).values())
    return FrozenMap(
        {marker.name: marker.body for marker in model.markers if marker.body in patellae}
    )


def with_markers_on_patellae(model: Model) -> Model:
    """Let markers that lie on patellae by their names follow these instead of the thighs.

    A patella moves on the thigh by some 5 cm while the knee bends by 60 degrees; a marker on it
    that the model has on the thigh would turn the thigh by it. In the default pose all markers stay
    where they are.

    Parameters
    ----------
    model : with markers

    Returns
    -------
    the same model where no marker changes its body
    """
    patellae = guided_patellae(model)
    named = {name for name, site in recognize(model.marker_names).sites.items() if site.key == SITE}
    on_thigh = [
        marker for marker in model.markers if marker.name in named and marker.body in patellae
    ]
    if not on_thigh:
        return model
    poses = standing_poses(model)

    def moved(marker: Marker) -> Marker:
        """Attach a marker to the patella, at the same place in the default pose."""
        patella = patellae[marker.body]
        seen = poses[patella].inverse().apply(poses[marker.body].apply(marker.location))
        return replace(marker, body=patella, location=np.asarray(seen))

    moves = {marker.name: moved(marker) for marker in on_thigh}
    return model.with_markers(tuple(moves.get(marker.name, marker) for marker in model.markers))


def moved_marker_notes(given: Model, used: Model) -> Iterator[Message]:
    """Report the markers that `with_markers_on_patellae` moved.

    Parameters
    ----------
    given, used : the model before and after

    Yields
    ------
    one sentence, or none
    """
    pairs = zip(given.markers, used.markers, strict=True)
    moved = [f"{old.name} ({old.body})" for old, new in pairs if old.body != new.body]
    if moved:
        yield MARKERS.message(
            f"on patellae by their names, and on thighs in the model: {', '.join(moved)}; they"
            " follow the patellae",
            severity="good to know",
        )
