"""A man's arm muscles on a mouse's bones.

They are compared with the nine muscles of a model of the mouse's forelimb.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.species import Compared, Ground, Muscles, arms_row, compare, percent
from benchmarks.species_cases import MAN, from_arm, given_map, man, mouse, segment_frame
from myomorph.bones.morph.morphed import Morph, MorphOptions
from myomorph.bones.morph.species.architecture import Size, architectures
from myomorph.bones.morph.species.counterparts import Posed
from myomorph.bones.morph.species.maps import joint_distances
from myomorph.bones.morph.transfer.model import Graft, graft_muscles
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.surfaces.linear_maps import Similarity

FORELIMB = "mouse-arm-muscles/akira_muscle.xml"
METHODS = ("scaling", "SSD", "RBF")
RIGHT = np.array([1.0, 0.0, 0.0])
SHOULDER = "mouse__RHumerus"
ELBOW = "mouse__RUlna"
WRIST = "mouse__RCarpus"


def forelimb(data: Path) -> mm.Model:
    """Read the forelimb, without the bone meshes that its file names and the collection lacks."""
    text = (data / FORELIMB).read_text(encoding="utf-8-sig")
    bare = re.sub(r"<(?:mesh|geom)\b[^>]*mesh[^>]*/>|<mesh\b[^>]*/>", "", text)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "forelimb.xml"
        file.write_text(bare)
        return mm.read_model(file)


@cache
def forelimb_on_skeleton(data: Path) -> Morph:
    """Return the forelimb's muscles on the skeleton.

    The humerus is laid by shoulder and elbow, the forearm by elbow and wrist, by the elbow's axis;
    scapula and clavicle by the shoulder, in the humerus's size and as the frames lie.
    """
    arm = forelimb(data)
    skeleton = mouse(data).model
    here = Posed(arm, {})
    there = Posed(skeleton, {})
    found = {}
    for body, target, far in (
        ("humerus", SHOULDER, ("ulna", ELBOW)),
        ("ulna", ELBOW, ("wrist_body", WRIST)),
    ):
        ours = _joint(here, body, far[0])
        theirs = _joint(there, target, far[1])
        size = float(np.linalg.norm(theirs) / np.linalg.norm(ours))
        found[body] = Similarity(
            segment_frame(theirs, RIGHT).T @ segment_frame(ours, RIGHT), np.zeros(3), size
        )
    size = found["humerus"].scale
    shoulder = there.within(SHOULDER, "mouse__RScapula").translation
    for body in ("scapula", "clavicle"):
        found[body] = Similarity(
            np.eye(3), shoulder - size * here.within("humerus", body).translation, size
        )
    whole = found["ulna"]
    pose = here.within("radius", "ulna")
    found["radius"] = Similarity(
        whole.rotation @ pose.rotation, whole.apply(pose.translation), whole.scale
    )
    targets = {"humerus": SHOULDER, "ulna": ELBOW, "radius": ELBOW}
    bones = {
        body: given_map(body, targets.get(body, "mouse__RScapula"), one)
        for body, one in found.items()
    }
    options = MorphOptions(surface_within=0.0, clear=False, fibers="keep", force="keep")
    graft = Graft(coordinates={"elbow": ("mouse__RElbow_flexion", 1.0, 0.0)})
    return graft_muscles(arm, skeleton, bones, options, graft)


def _joint(posed: Posed, body: str, other: str) -> np.ndarray:
    return posed.within(other, body).translation


def ground(data: Path) -> Ground:
    """Return the skeleton with its elbow at a right angle."""
    skeleton = mouse(data)
    posed = Posed(skeleton.model, {})
    lengths = {
        "mouse__RScapula": float(np.ptp(skeleton.surfaces["mouse__RScapula"].vertices[:, 1])),
        SHOULDER: float(np.linalg.norm(_joint(posed, SHOULDER, ELBOW))),
        ELBOW: float(np.linalg.norm(_joint(posed, ELBOW, WRIST))),
    }
    coordinates = {
        "shoulder flexion": "mouse__RShoulder_flexion",
        "shoulder adduction": "mouse__RShoulder_adduction",
        "shoulder rotation": "mouse__RShoulder_rotation",
        "elbow": "mouse__RElbow_flexion",
    }
    return Ground({"mouse__RElbow_flexion": 0.5 * np.pi}, coordinates, lengths)


@cache
def compared(data: Path, method: str) -> tuple[Compared, ...]:
    """Every homologous muscle."""
    where = ground(data)
    found = Muscles(from_arm(data, method).model, where)
    truth = Muscles(forelimb_on_skeleton(data).model, where)
    names = set(found.model.muscle_names)
    pairs = [one for one in read_species("human-mouse-arm").muscles if set(one.sources) <= names]
    return tuple(compare(found, truth, one, where) for one in pairs)


def _there(data: Path) -> bool:
    return (data / FORELIMB).exists() and (data / "mouse-skeleton-keypoints").exists()


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each muscle."""
    if not _there(data):
        return
    by_method = {method: compared(data, method) for method in METHODS}
    for i, one in enumerate(by_method["SSD"]):
        row: dict[str, object] = {"muscle": one.name}
        for method, rows in by_method.items():
            row[f"{method}: origin, insertion, path [%]"] = (
                f"{100 * rows[i].origin:.0f}, {100 * rows[i].insertion:.0f},"
                f" {100 * rows[i].path:.0f}"
            )
        yield row
    total: dict[str, object] = {"muscle": "both ends, median / worst"}
    for method, rows in by_method.items():
        total[f"{method}: origin, insertion, path [%]"] = percent(
            [e for one in rows for e in (one.origin, one.insertion)]
        )
    yield total


def measure_arms(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each coordinate and method: whether moment arms have the same sign and order.

    They are compared with the other model's.
    """
    if not _there(data):
        return
    for word in ground(data).coordinates:
        for method in METHODS:
            yield arms_row(word, method, compared(data, method))


def measure_architecture(data: Path) -> Iterator[dict[str, object]]:
    """Compare forces and fibers by the leg's scaling with those of the forelimb's model.

    They are what the leg's tables give for it.
    """
    if not _there(data) or not (data / MAN).exists():
        return
    law = read_species("human-mouse-arm").scaling
    assert law is not None
    fiber, force = leg_ratios(data)
    yield {
        "what": "the leg's muscles, the mouse's over the man's in the bones' size",
        "muscles": len(fiber),
        **_spread("fiber", fiber),
        **_spread("force", force),
    }
    yield {
        "what": "`human-mouse-arm` has",
        "fiber, median": law.fiber,
        "fiber, 90 % of the spread": _factors(law.fiber_interval),
        "force, median": law.force,
        "force, 90 % of the spread": _factors(law.force_interval),
    }
    ours = from_arm(data, "SSD").model
    theirs = forelimb_on_skeleton(data).model
    pairs = [
        one
        for one in read_species("human-mouse-arm").muscles
        if set(one.sources) <= set(ours.muscle_names)
    ]
    both = [(ours.muscle(one.sources[0]), theirs.muscle(one.targets[0])) for one in pairs]
    inside: dict[str, object] = {}
    for name, key, (low, high) in (
        ("fiber", "optimal_fiber_length", law.fiber_interval),
        ("force", "max_isometric_force", law.force_interval),
    ):
        ratio = np.array([getattr(mine, key) / getattr(other, key) for mine, other in both])
        inside[f"{name}, median"] = float(np.median(ratio))
        inside[f"{name}, minimum and maximum"] = f"{ratio.min():.2f} to {ratio.max():.2f}"
        count = np.sum((low <= 1 / ratio) & (1 / ratio <= high))
        inside[f"{name}, in its interval"] = f"{count} of {len(ratio)}"
    yield {"what": "the arm's muscles, ours over the forelimb's", "muscles": len(both), **inside}


def leg_ratios(data: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return ratios of the leg's muscles, mouse to man, in the bones' size.

    Parameters
    ----------
    data : folder of the collection

    Returns
    -------
    (muscles,) fiber length, and (muscles,) force, of the mouse's table over the man's
    """
    table = read_species("human-mouse")
    source = man(data).model
    first = table.architecture[0]
    length = sum(first.lengths.values()) / joint_distances(
        first.lengths, replace(table, posture={}), source, "source"
    )
    known = architectures(source, (first,), (Size(),), source.muscle_names)
    pairs = [
        (one, source.muscle(name))
        for name, one in known.items()
        if one.basis.startswith(first.species)
    ]
    fiber = np.array([one.fiber / own.optimal_fiber_length / length for one, own in pairs])
    force = np.array([one.force / own.max_isometric_force / length**2 for one, own in pairs])
    return fiber, force


def _spread(name: str, ratio: np.ndarray) -> dict[str, object]:
    most = float(np.exp(half_width(np.log(ratio).std(ddof=1))))
    return {
        f"{name}, median": float(np.median(ratio)),
        f"{name}, 90 % of the spread": _factors((1.0 / most, most)),
        f"{name}, minimum and maximum": f"{ratio.min():.2f} to {ratio.max():.2f}",
        f"{name}, in its interval": "",
    }


def _factors(interval: tuple[float, float]) -> str:
    return f"times {interval[0]:.3f} to {interval[1]:.2f}"
