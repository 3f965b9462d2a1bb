"""A man's arm muscles on a mouse's bones, against the nine muscles of a model of the mouse's forelimb."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.accuracy.morph.species import Compared, Ground, Muscles, compare, percent
from benchmarks.species_cases import Bodies, given_map, mouse, scaling_table, segment_frame
from myomorph.model.model import Model
from myomorph.morph.maps.fields import MapOptions
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.morphed import Morph, MorphOptions
from myomorph.morph.registration.smooth import MatchOptions
from myomorph.morph.species.counterparts import Posed
from myomorph.morph.species.maps import species_morph
from myomorph.morph.transfer.model import graft_muscles
from myomorph.simulate.shoulder import arm_model
from myomorph.study.subject.morph_files import source_bones
from myomorph.study.subject.species_morphing import read_species
from myomorph.study.trial.inputs import open_model

FORELIMB = "mouse-arm-muscles/akira_muscle.xml"
METHODS = {"scaling": ("affine", "box"), "SSD": ("ssd", "dense"), "RBF": ("rbf", "dense")}
RIGHT = np.array([1.0, 0.0, 0.0])
SHOULDER, ELBOW, WRIST = "mouse__RHumerus", "mouse__RUlna", "mouse__RCarpus"


def forelimb(data: Path) -> Model:
    """The forelimb, without the bone meshes that its file names and the collection lacks."""
    text = (data / FORELIMB).read_text(encoding="utf-8-sig")
    bare = re.sub(r"<(?:mesh|geom)\b[^>]*mesh[^>]*/>|<mesh\b[^>]*/>", "", text)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "forelimb.xml"
        file.write_text(bare)
        return open_model(file)


@cache
def forelimb_on_skeleton(data: Path) -> Morph:
    """The forelimb's muscles on the skeleton: humerus by shoulder and elbow, forearm by elbow and wrist, by the
    elbow's axis; scapula and clavicle by the shoulder, in the humerus's size and as the frames lie.
    """
    arm, skeleton = forelimb(data), mouse(data).model
    here, there = Posed(arm, {}), Posed(skeleton, {})
    found = {}
    for body, target, far in (("humerus", SHOULDER, ("ulna", ELBOW)), ("ulna", ELBOW, ("wrist_body", WRIST))):
        ours, theirs = _joint(here, body, far[0]), _joint(there, target, far[1])
        size = float(np.linalg.norm(theirs) / np.linalg.norm(ours))
        found[body] = Similarity(segment_frame(theirs, RIGHT).T @ segment_frame(ours, RIGHT), np.zeros(3), size)
    size = found["humerus"].scale
    shoulder = there.within(SHOULDER, "mouse__RScapula").translation
    for body in ("scapula", "clavicle"):
        found[body] = Similarity(np.eye(3), shoulder - size * here.within("humerus", body).translation, size)
    whole, pose = found["ulna"], here.within("radius", "ulna")
    found["radius"] = Similarity(whole.rotation @ pose.rotation, whole.apply(pose.translation), whole.scale)
    targets = {"humerus": SHOULDER, "ulna": ELBOW, "radius": ELBOW}
    bones = {body: given_map(body, targets.get(body, "mouse__RScapula"), one) for body, one in found.items()}
    options = MorphOptions(surface_within=0.0, clear=False, fibers="keep", force="keep")
    return graft_muscles(arm, skeleton, bones, options, coordinates={"elbow": ("mouse__RElbow_flexion", 1.0, 0.0)})


def _joint(posed: Posed, body: str, other: str) -> np.ndarray:
    return posed.within(other, body).translation


@cache
def from_arm(data: Path, method: str) -> Morph:
    """The man's arm muscles on the mouse's skeleton."""
    kind, features = METHODS[method]
    table, target, source = read_species("human-mouse-arm"), mouse(data), arm_model()
    man = Bodies(source, source_bones(source, None, []))
    return species_morph(
        man.model,
        man.surfaces,
        target.model,
        target.surfaces,
        scaling_table(table) if features == "box" else table,
        map_options=MapOptions(kind),  # type: ignore[arg-type]
        match=MatchOptions(),
    )


def ground(data: Path) -> Ground:
    """The skeleton with its elbow at a right angle."""
    skeleton = mouse(data)
    posed = Posed(skeleton.model, {})
    lengths = {
        "mouse__RScapula": float(np.ptp(skeleton.surfaces["mouse__RScapula"].vertices[:, 1])),
        SHOULDER: float(np.linalg.norm(_joint(posed, SHOULDER, ELBOW))),
        ELBOW: float(np.linalg.norm(_joint(posed, ELBOW, WRIST))),
    }
    return Ground({"mouse__RElbow_flexion": 0.5 * np.pi}, {"elbow": "mouse__RElbow_flexion"}, lengths)


@cache
def compared(data: Path, method: str) -> tuple[Compared, ...]:
    """Every homologous muscle."""
    where = ground(data)
    found, truth = Muscles(from_arm(data, method).model, where), Muscles(forelimb_on_skeleton(data).model, where)
    names = set(found.model.muscle_names)
    pairs = [one for one in read_species("human-mouse-arm").muscles if set(one.sources) <= names]
    return tuple(compare(found, truth, one, where) for one in pairs)


def measure(data: Path) -> Iterator[dict[str, object]]:
    """A row a muscle."""
    if not (data / FORELIMB).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    by_method = {method: compared(data, method) for method in METHODS}
    for i, one in enumerate(by_method["SSD"]):
        row: dict[str, object] = {"muscle": one.name}
        for method, rows in by_method.items():
            row[f"{method}: origin, insertion, path [%]"] = (
                f"{100 * rows[i].origin:.0f}, {100 * rows[i].insertion:.0f}, {100 * rows[i].path:.0f}"
            )
        ours, theirs = one.arms["elbow"].mean(axis=1)
        row["moment arm at the elbow, SSD / theirs [mm]"] = f"{1e3 * ours:.2f} / {1e3 * theirs:.2f}"
        yield row
    total: dict[str, object] = {"muscle": "both ends, median / worst"}
    for method, rows in by_method.items():
        total[f"{method}: origin, insertion, path [%]"] = percent(
            [e for one in rows for e in (one.origin, one.insertion)]
        )
    total["moment arm at the elbow, SSD / theirs [mm]"] = ""
    yield total
