"""Body shape: measurements reached, mass fractions of segments, models posed in the skin."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import myomorph as mm
from myomorph.body.shape.fit_pose import pose_model_to_skin
from myomorph.body.shape.points import SPACING, fill, links_of
from myomorph.body.shape.shape import DENSITY, body_shape
from myomorph.body.shape.skin import inside
from myomorph.body.shape.weights import links_with_mass
from myomorph.core.model.segments import SEGMENTS, Segment

PEOPLE = {
    "[D]'s subject": (1.822, 0.870, 66.8, "male"),
    "[D]'s subject, mass not given": (1.822, 0.870, None, "male"),
    "[D]'s subject, mass and sex not given": (1.822, 0.870, None, None),
    "small woman": (1.55, 0.85, 50.0, "female"),
    "heavy man": (1.75, 1.15, 105.0, "male"),
}
MODELS = {
    "gait2354 scaled": "opensim-gait-subject01/ref_id/subject01.osim",
    "Rajagopal scaled": "rajagopal-walk-emg/subject_walk_scaled.osim",
    "Hamner generic": "hamner-run-subject04/unscaled_generic.osim",
    "171 coordinates": "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
    "Lenhart": "lenhart-knee-contact-walk/lenhart2015.osim",
}
PUBLISHED = {
    "head": 6.9,
    "upper_trunk": 30.2,
    "lower_trunk": 18.7,
    "upper_arm": 2.7,
    "lower_arm": 1.6,
    "hand": 0.6,
    "thigh": 11.0,
    "shank": 5.1,
    "foot": 1.1,
}
"""Percent of body mass of Japanese male athletes, one side, Ae et al. as printed in [D] table 3.4.
"""


def measure_people() -> Iterator[dict[str, object]]:
    """Compare the requested sizes of the statistical shape with those that it has."""
    for name, (height, chest, mass, sex) in PEOPLE.items():
        shape = body_shape(height, chest, mass, sex)
        yield {
            "person": name,
            "requested height, error [mm]": (
                f"{1e3 * height:.0f}, {1e3 * (shape.reached['height'] - height):+.2f}"
            ),
            "requested chest, error [mm]": (
                f"{1e3 * chest:.0f}, {1e3 * (shape.reached['chest'] - chest):+.2f}"
            ),
            "requested mass [kg]": "" if mass is None else mass,
            f"volume x {DENSITY:g} [kg]": shape.reached["mass"],
            "points at 5 mm": len(fill(shape.skin, SPACING)),
        }


def measure_segments() -> Iterator[dict[str, object]]:
    """Shares of segments by the skin's skinning, at even density."""
    shape = body_shape(1.822, 0.870, 66.8, "male")
    points = fill(shape.skin, 0.01)
    nearest = cKDTree(shape.skin.surface.vertices).query(points, k=1)[1]
    share = np.asarray(shape.skinning[nearest].mean(axis=0)).ravel()
    by_segment = dict(zip(shape.segments, 100.0 * share, strict=True))
    for name in SEGMENTS:
        one = by_segment.get(Segment(name), by_segment.get(Segment(name, "right"), 0.0))
        yield {"segment": name, "shape [%]": float(one), "Ae et al. [%]": PUBLISHED[name]}


def measure_poses(folder: Path) -> Iterator[dict[str, object]]:
    """Errors of models' virtual markers in the skin of a body of their mass and 1.80 m."""
    for name, path in MODELS.items():
        model = mm.read_model(folder / path)
        fit = pose_model_to_skin(model, body_shape(1.80, 0.95, model.mass))
        sided = [
            e
            for n, e in zip(fit.names, fit.errors, strict=True)
            if n.startswith(("right ", "left "))
        ]
        links = links_of(model, fit.motion)
        heavy = links_with_mass(model)
        within = inside(fit.skin, links.centers[heavy])
        yield {
            "model": name,
            "virtual markers": len(fit.names),
            "joint centers of limbs, RMS [mm]": float(1e3 * np.sqrt(np.mean(np.square(sided)))),
            "worst of all [mm]": (
                f"{1e3 * fit.errors.max():.0f} ({fit.names[int(fit.errors.argmax())]})"
            ),
            "mass centers inside the skin": f"{int(within.sum())} of {len(within)}",
        }
