"""Mass points of a subject.

They follow from a skin mesh, from height and chest, or from envelopes of the model's own links.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy

from myomorph.body.identify.link_prior import with_people_spread
from myomorph.body.identify.validation import Inside
from myomorph.body.shape.body_segments import segment_masses
from myomorph.body.shape.envelope import own_points
from myomorph.body.shape.points import Links, MassPoints, fill, links_of, reference_masses
from myomorph.body.shape.skin import check_skin, inside
from myomorph.body.shape.weights import (
    bone_weights,
    cog_weights,
    links_with_mass,
    nearest_weights,
)
from myomorph.core.io.landmarks import read_landmarks
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.segments import Segment, segments_of
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.surface import Surface
from myomorph.lab.store.progress import progress
from myomorph.lab.study.inputs.reading import about
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

if TYPE_CHECKING:
    from myomorph.body.shape.fit_pose import PoseFit
    from myomorph.body.shape.shape import Shape

OWN = "own"  # Weight map of envelopes: each point belongs to the link whose envelope it fills.
SPREAD_SPACING = 0.012  # Of points that weigh the segments, for how far people's differ [m]
WEIGHT_MAPS = {"bone": bone_weights, "cog": cog_weights, "nearest": nearest_weights}
"""By the names of the command."""


def body_points(  # page: a body and what is known of it, the comparison and meshes optional
    model: Model,
    shape: BodyShape,
    mass: float,
    options: BodyOptions,
    compare: bool = True,
    surfaces: Mapping[str, Surface] | None = None,
) -> tuple[dict[str, MassPoints], Inside | None, tuple[Message, ...]]:
    """Return mass points by weight map, the one to use first.

    With them come a test of what is inside the skin, and notes.

    Parameters
    ----------
    model : of the body
    shape : what is known of it: a skin, or height and chest [m]; nothing for envelopes of the links
    mass : of the whole body [kg]
    options : spacing of the points [m], weight map and density; see `BodyOptions`
    compare : also by the other weight maps, where a skin makes them differ
    surfaces : meshes of the model's bodies

    Returns
    -------
    points by weight map; a test of points (points, 3) [m], None without a skin; notes

    Raises
    ------
    BadData : a shape that cannot be, or more points than memory holds

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> coarse = mm.BodyOptions(spacing=0.05)
    >>> points, inside, notes = mm.body_points(model, mm.BodyShape(), 4.0, coarse)
    >>> list(points), round(float(points["own"].reference.sum()), 3), inside
    (['own'], 4.0, None)
    """
    if not 0.0005 <= options.spacing <= 0.1:
        raise BadData(
            f"--spacing {options.spacing:g}: expected a distance in metres from 0.0005 to 0.1, as"
            " 0.005"
        )
    if shape.skin is not None or shape.height is not None or shape.chest is not None:
        return _in_skin(model, shape, mass, options, compare)
    points = own_points(model, DEFAULT_POSE, mass, options.spacing, surfaces)
    if options.weights is None:
        return {OWN: points}, None, ()
    weights = _weights(model, points.points, points.links, (options.weights,))
    return (
        _made(
            points.points, points.reference, weights, points.links, options.spacing, points.source
        ),
        None,
        (),
    )


def _weights(
    model: Model, points: Array, links: Links, names: Sequence[str]
) -> dict[str, scipy.sparse.csr_array]:
    """Weights of points by the maps' names, links without mass left out."""
    taking = links_with_mass(model)
    result: dict[str, scipy.sparse.csr_array] = {}
    with progress("weights of mass points", len(names), "maps") as advance:
        for name in names:
            result[name] = WEIGHT_MAPS[name](points, links, taking=taking)
            advance(1)
    return result


def _made(
    points: Array,
    reference: Array,
    weights: Mapping[str, scipy.sparse.csr_array],
    links: Links,
    spacing: float,
    source: str,
) -> dict[str, MassPoints]:
    return {
        name: MassPoints(
            points=points,
            reference=reference,
            weights=weight,
            links=links,
            spacing=spacing,
            source=source,
        )
        for name, weight in weights.items()
    }


@read_only
class _Posed:
    """A model in a person's skin.

    Attributes
    ----------
    fitted : the model's pose and the skin in it
    source : what the skin is, in words
    notes : of the skin
    errors : relative standard deviations of segments' masses among people with the same
        measurements; none where no survey says them
    """

    fitted: PoseFit
    source: str
    notes: tuple[Message, ...]
    errors: Mapping[Segment, float]


def _in_skin(
    model: Model, shape: BodyShape, mass: float, options: BodyOptions, compare: bool
) -> tuple[dict[str, MassPoints], Inside | None, tuple[Message, ...]]:
    """Points inside the user's skin, or that of a statistical body, with the model posed in it."""
    if shape.skin is None:
        posed = _in_statistical_body(model, shape, mass)
    else:
        posed = _in_own_skin(model, shape, shape.skin)
    skin = posed.fitted.skin
    with about(shape.skin or "the body"):
        points = fill(skin, options.spacing)
    links = links_of(model, posed.fitted.motion)
    first = options.weights or "bone"
    names = (first, *(kind for kind in WEIGHT_MAPS if kind != first and compare))
    weights = _weights(model, points, links, names)
    regions = _regions(model, weights[first]) if options.density == "segments" else None
    reference = reference_masses(points, mass, regions)
    made = _made(points, reference, weights, links, options.spacing, posed.source)
    segments = segments_of(model)
    made = {name: with_people_spread(one, segments, posed.errors) for name, one in made.items()}
    return made, lambda places: inside(skin, places), (*posed.notes, *posed.fitted.notes)


def _in_own_skin(model: Model, shape: BodyShape, file: Path) -> _Posed:
    """Pose the model in a scan."""
    # Loaded only where a skin is asked for: it brings the statistical body.
    from myomorph.body.shape.fit_pose import pose_model_to_skin

    with about(file):
        skin = check_skin(read_mesh(file), shape.height)
    landmarks = None if shape.landmarks is None else read_landmarks(shape.landmarks)
    with about(shape.landmarks or file):
        fitted = pose_model_to_skin(model, skin, landmarks)
    return _Posed(fitted=fitted, source=f"the skin {file.name}", notes=skin.notes, errors={})


def _in_statistical_body(model: Model, shape: BodyShape, mass: float) -> _Posed:
    """Pose the model in the body of height and chest."""
    # Loaded only where a skin is asked for: it brings the statistical body.
    from myomorph.body.shape.fit_pose import pose_model_to_skin

    body = _statistical(shape, mass)
    reached = ", ".join(f"{name} {value:.4g}" for name, value in body.reached.items())
    return _Posed(
        fitted=pose_model_to_skin(model, body),
        source=f"a statistical body ({reached})",
        notes=body.notes,
        errors=_people_errors(body, mass),
    )


def _people_errors(body: Shape, mass: float) -> Mapping[Segment, float]:
    """Errors of segments' masses among people with the same measurements; none of a child's."""
    if body.alike is None:
        return {}
    return {part.segment: part.sd for part in segment_masses(body, mass, SPREAD_SPACING)}


def _regions(model: Model, weights: scipy.sparse.csr_array) -> np.ndarray:
    """(points,) segment of the body that has the largest share of each point."""
    segments = segments_of(model)
    names = np.array([segments[body].name for body in model.body_names])
    return names[np.asarray(weights.argmax(axis=1)).ravel()]


def _statistical(shape: BodyShape, mass: float) -> Shape:
    from myomorph.body.shape.shape import body_shape

    if shape.height is None:
        raise BadData("--chest needs --height beside it, in metres")
    return body_shape(shape.height, shape.chest, mass, shape.sex, shape.age)
