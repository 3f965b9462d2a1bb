"""A man's leg muscles on a mouse's bones, against an anatomist's table of the mouse."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

import myomorph as mm
from benchmarks.species_cases import (
    METHODS,
    MOUSE_AXES,
    SEGMENTS,
    Alignment,
    anatomist_on_skeleton,
    from_man,
    from_man_by_joints,
    mouse,
)
from myomorph.bones.morph.species.counterparts import MuscleHomology, Posed
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.muscles.model_paths import compile_paths
from truths.mouse_hindlimb import mouse_hindlimb_model

ANATOMIST = "mouse-hindlimb-muscles/mouse_hindlimb.json"
BENT = 0.5 * np.pi
STEPS = 9
"""Values of a coordinate at which moment arms are taken."""
COUNTS = 0.1
"""A muscle counts about a coordinate where its moment arm is this share of the largest one."""
POINTS = 30
"""Of a path, evenly along it, that are held against the other path."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Where two sets of muscles are compared.

    `posture`: of the skeleton both are on; `coordinates`: by word, the skeleton's; `lengths`: of
    bones by body [m].
    """

    posture: Mapping[str, float]
    coordinates: Mapping[str, str]
    lengths: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Compared:
    """One muscle of both.

    `origin`, `insertion`, `path`: errors in shares of the bones' lengths; `arms`: by coordinate,
    (2, steps) moment arms of transfer and anatomist [m].
    """

    name: str
    origin: float
    insertion: float
    path: float
    arms: Mapping[str, np.ndarray]


def _nodes(model: mm.Model, ground: Ground) -> np.ndarray:
    """Return the points (muscles, points, 3) of all paths in a posture [m], NaN behind the last."""
    paths = compile_paths(model)
    values = np.array([[ground.posture[one] for one in ground.posture]])
    posture = mm.Motion(np.zeros(1), tuple(ground.posture), values)
    nodes: np.ndarray = paths.nodes(paths.tree.coordinates_of(posture))[0, :, :, :3]
    return nodes


def _arms_about(model: mm.Model, ground: Ground, name: str) -> np.ndarray:
    """Return moment arms (steps, muscles) about a coordinate over its range [m]."""
    low, high = model.coordinate(name).range
    others = tuple(one for one in ground.posture if one != name)
    values = np.tile([ground.posture.get(one, 0.0) for one in (*others, name)], (STEPS, 1))
    values[:, -1] = np.linspace(low, high, STEPS)
    motion = mm.Motion(np.arange(STEPS, dtype=np.float64), (*others, name), values)
    found = mm.muscle_kinematics(model, motion, velocities=False)
    column = model.coordinate_names.index(name)
    arms: np.ndarray = found.moment_arm[:, :, column]
    return arms


class Muscles:
    """Ends, paths and moment arms of a model's muscles in one posture."""

    def __init__(self, model: mm.Model, ground: Ground):
        self.model = model
        self._bodies: list[list[str]] = []
        self._nodes: list[np.ndarray] = []
        # Files begin a muscle at either end; here the one on the body nearer to the root comes
        # first.
        rank = {name: i for i, name in enumerate(model.body_names)}
        for muscle, nodes in zip(model.muscles, _nodes(model, ground), strict=True):
            ends = [muscle.path.points[i].body for i in (0, -1)]
            turned = rank[ends[-1]] < rank[ends[0]]
            known = nodes[np.isfinite(nodes[:, 0])]
            self._bodies.append(ends[::-1] if turned else ends)
            self._nodes.append(known[::-1] if turned else known)
        self.arms = {
            word: _arms_about(model, ground, name) for word, name in ground.coordinates.items()
        }

    def ends(self, names: tuple[str, ...], which: int) -> np.ndarray:
        """Return an end of a muscle, the middle of several parts.

        Parameters
        ----------
        names : of the parts
        which : 0 for the first, -1 for the last

        Returns
        -------
        (3,) in ground [m]
        """
        return np.mean(
            [self._nodes[self.model.muscle_names.index(one)][which] for one in names], axis=0
        )

    def body(self, name: str, which: int) -> str:
        """Body of an end."""
        return self._bodies[self.model.muscle_names.index(name)][which]

    def path(self, name: str) -> np.ndarray:
        """Return the points through which a muscle runs.

        Parameters
        ----------
        name : of the muscle

        Returns
        -------
        (points, 3) in ground [m]
        """
        return self._nodes[self.model.muscle_names.index(name)]

    def arm(self, names: tuple[str, ...], word: str) -> np.ndarray:
        """Return the moment arm of a muscle, the mean of several parts.

        Parameters
        ----------
        names : of the parts
        word : that names the coordinate

        Returns
        -------
        (steps,) over the coordinate's range [m]
        """
        columns = [self.model.muscle_names.index(one) for one in names]
        mean: np.ndarray = self.arms[word][:, columns].mean(axis=1)
        return mean


def along(path: np.ndarray) -> np.ndarray:
    """Return points evenly along a path.

    Parameters
    ----------
    path : (points, 3) [m]

    Returns
    -------
    (`POINTS`, 3) [m]
    """
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    wanted = np.linspace(0.0, reached[-1], POINTS)
    return np.column_stack([np.interp(wanted, reached, column) for column in path.T])


def apart(points: np.ndarray, path: np.ndarray) -> float:
    """Return the mean distance of points from a path.

    Parameters
    ----------
    points : (n, 3) [m]
    path : (k, 3) [m]

    Returns
    -------
    [m]
    """
    start = path[:-1]
    step = np.diff(path, axis=0)
    squared = np.maximum((step**2).sum(axis=1), 1e-20)
    share = np.clip(((points[:, None] - start) * step).sum(axis=2) / squared, 0.0, 1.0)
    nearest = start + share[:, :, None] * step
    return float(np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1).mean())


def compare(found: Muscles, truth: Muscles, pair: MuscleHomology, ground: Ground) -> Compared:
    """One muscle of the transfer against the anatomist's."""
    errors = []
    lengths = []
    for which in (0, -1):
        lengths.append(ground.lengths[truth.body(pair.targets[0], which)])
        away = found.ends(pair.sources, which) - truth.ends(pair.targets, which)
        errors.append(float(np.linalg.norm(away)) / lengths[-1])
    beside = [
        min(apart(along(truth.path(theirs)), found.path(ours)) for ours in pair.sources)
        for theirs in pair.targets
    ]
    arms = {
        word: np.stack([found.arm(pair.sources, word), truth.arm(pair.targets, word)])
        for word in ground.coordinates
    }
    origin, insertion = errors
    return Compared(
        name=", ".join(pair.targets),
        origin=origin,
        insertion=insertion,
        path=float(np.mean(beside)) / float(np.mean(lengths)),
        arms=arms,
    )


def on_skeleton(data: Path) -> Ground:
    """Return the skeleton of stac-mjx."""
    bodies = mouse(data)
    joints = Posed(bodies.model, {}).joints("mouse")
    chain = [joints[SEGMENTS[one][0]] for one in ("Thigh_r", "Leg_r", "Foot_r", "Toes_r")]
    thigh, shank, foot = [float(np.linalg.norm(b - a)) for a, b in pairwise(chain)]
    lengths = {
        "mouse": float(np.ptp(bodies.surfaces["mouse"].vertices[:, 1])),
        "mouse__RFemur": thigh,
        "mouse__RTibia": shank,
        "mouse__RTarsus": foot,
        "mouse__RBPhalange3": foot,
    }
    coordinates = {
        "hip flexion": "mouse__RHip_flexion",
        "hip adduction": "mouse__RHip_adduction",
        "hip rotation": "mouse__RHip_rotation",
        "knee": "mouse__RKnee_flexion",
        "ankle": "mouse__RAnkle_flexion",
    }
    return Ground({"mouse__RKnee_flexion": -BENT}, coordinates, lengths)


def on_anatomist(data: Path) -> Ground:
    """Return the anatomist's own model.

    No length is known of its pelvis, which is in proportion to the skeleton's.
    """
    model = mouse_hindlimb_model(data / ANATOMIST)
    skeleton = mouse(data).model
    laid = Alignment(model, skeleton)
    there = on_skeleton(data)
    lengths = {
        body: there.lengths[target] / laid.similarity(body).scale
        for body, (target, _, _) in SEGMENTS.items()
    }
    coordinates = {
        "hip flexion": "Hip_flexion_r",
        "hip adduction": "Hip_adduction_r",
        "hip rotation": "Hip_rotation_r",
        "knee": "Knee_extension_r",
        "ankle": "Ankle_flexion_r",
    }
    return Ground({"Knee_extension_r": -BENT}, coordinates, lengths)


@cache
def compared(data: Path, method: str, rule: str = "joints") -> tuple[Compared, ...]:
    """Compare every homologous muscle, by one method and one alignment.

    The alignment is a way to lay the anatomist's muscles on the bones.
    """
    if method == "joints alone":
        ground = on_anatomist(data)
        found = Muscles(from_man_by_joints(data).model, ground)
        truth = Muscles(mouse_hindlimb_model(data / ANATOMIST), ground)
    else:
        ground = on_skeleton(data)
        found = Muscles(from_man(data, method).model, ground)
        truth = Muscles(anatomist_on_skeleton(data, rule).model, ground)
    pairs = read_species("human-mouse").muscles
    return tuple(compare(found, truth, one, ground) for one in pairs)


def percent(values: list[float]) -> str:
    """Median and worst."""
    return f"{100 * np.median(values):.0f} / {100 * max(values):.0f}"


def measure(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each method.

    It has how far the muscles are from the anatomist's, median and worst, in percent of bone
    length.
    """
    if not (data / ANATOMIST).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    for method in (*METHODS, "joints alone"):
        rows = compared(data, method)
        yield {
            "map": method,
            "on": "the anatomist's model" if method == "joints alone" else "the skeleton's bones",
            "muscles": len(rows),
            "origin [%]": percent([one.origin for one in rows]),
            "insertion [%]": percent([one.insertion for one in rows]),
            "both ends [%]": percent([end for one in rows for end in (one.origin, one.insertion)]),
            "path [%]": percent([one.path for one in rows]),
            "both ends, his moved onto the bones [%]": (
                ""
                if method == "joints alone"
                else percent(
                    [
                        end
                        for one in compared(data, method, "onto bones")
                        for end in (one.origin, one.insertion)
                    ]
                )
            ),
        }


def measure_muscles(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each muscle.

    It has errors by three maps, and what the alignment leaves undetermined.
    """
    if not (data / ANATOMIST).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    by_method = {
        method: compared(data, method) for method in ("scaling", "SSD", "RBF", "joints alone")
    }
    pairs = read_species("human-mouse").muscles
    for i, pair in enumerate(pairs):
        row: dict[str, object] = {
            "of man": ", ".join(pair.sources),
            "of the mouse": ", ".join(pair.targets),
        }
        for method, found in by_method.items():
            one = found[i]
            row[f"{method}: origin, insertion, path [%]"] = (
                f"{100 * one.origin:.0f}, {100 * one.insertion:.0f}, {100 * one.path:.0f}"
            )
        row["open in the alignment: origin, insertion [%]"] = _open(data, pair)
        yield row


RULES = ("joints", "frames", "pelvis by joints")


def _open(data: Path, pair: MuscleHomology) -> str:
    """How far the anatomist's ends move when the alignment is made in the other ways."""
    ground = on_skeleton(data)
    ways = [
        Muscles(anatomist_on_skeleton(data, rule).model, ground)
        for rule in ("joints", "frames", "pelvis by joints")
    ]
    shown = []
    for which in (0, -1):
        ends = [one.ends(pair.targets, which) for one in ways]
        most = max(float(np.linalg.norm(one - ends[0])) for one in ends[1:])
        bone = ground.lengths[ways[0].body(pair.targets[0], which)]
        shown.append(f"{100 * most / bone:.0f}")
    return ", ".join(shown)


def other_signs(rows: tuple[Compared, ...], word: str) -> list[str]:
    """Return muscles whose mean moment arm has another sign than the anatomist's.

    Only muscles that count about the coordinate are listed.
    """
    arms = np.array([one.arms[word].mean(axis=1) for one in rows])
    counts = np.abs(arms[:, 1]) >= COUNTS * np.abs(arms[:, 1]).max()
    return [rows[i].name for i in np.flatnonzero(counts & (arms[:, 0] * arms[:, 1] <= 0.0))]


def measure_arms(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each coordinate and method: whether moment arms have the same sign and order.

    They are compared with the anatomist's.
    """
    if not (data / ANATOMIST).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    for word in on_skeleton(data).coordinates:
        for method in ("scaling", "SSD", "RBF", "joints alone"):
            yield arms_row(word, method, compared(data, method))


def arms_row(word: str, method: str, rows: tuple[Compared, ...]) -> dict[str, object]:
    """Do moment arms about one coordinate have the truth's sign and order."""
    arms = np.array([one.arms[word] for one in rows])
    # A mean over the range tells the muscle's place among the others, whatever its sign does at the
    # ends.
    ours = arms[:, 0].mean(axis=1)
    theirs = arms[:, 1].mean(axis=1)
    counts = np.abs(theirs) >= COUNTS * np.abs(theirs).max()
    always = np.mean(arms[counts, 0] * arms[counts, 1] > 0)
    spanning = np.abs(arms).max(axis=(1, 2)) > 0
    return {
        "coordinate": word,
        "map": method,
        "muscles that count": int(counts.sum()),
        "same sign": f"{int((counts & (ours * theirs > 0)).sum())} of {int(counts.sum())}",
        "same sign over the range [%]": f"{100 * always:.0f}",
        "rank correlation": float(spearmanr(ours[spanning], theirs[spanning]).statistic),
        "slope (ours over theirs)": float(
            ours[counts] @ theirs[counts] / (theirs[counts] @ theirs[counts])
        ),
        "other sign": ", ".join(other_signs(rows, word)) or "none",
    }


def measure_signs(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each moment arm of the wrong sign by SSD [mm].

    It has the moment arm with the anatomist's ends, and by other alignments.
    """
    if not (data / ANATOMIST).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    ground = on_skeleton(data)
    pairs = read_species("human-mouse").muscles
    ours = from_man(data, "SSD").model
    theirs = anatomist_on_skeleton(data).model
    laid = {rule: Muscles(anatomist_on_skeleton(data, rule).model, ground) for rule in RULES}
    for word in ground.coordinates:
        wrong = other_signs(compared(data, "SSD"), word)
        for pair in (pair for pair in pairs if ", ".join(pair.targets) in wrong):
            row: dict[str, object] = {"coordinate": word, "muscle": ", ".join(pair.targets)}
            for column, ends in (
                ("ours [mm]", ()),
                ("with his origin [mm]", (0,)),
                ("with his insertion [mm]", (-1,)),
                ("with both [mm]", (0, -1)),
            ):
                found = Muscles(with_ends(ours, theirs, pair, ends), ground)
                row[column] = 1e3 * float(found.arm(pair.sources, word).mean())
            for rule, name in zip(
                RULES,
                ("his", "his, by the frames' directions", "his, pelvis by joints"),
                strict=True,
            ):
                row[f"{name} [mm]"] = 1e3 * float(laid[rule].arm(pair.targets, word).mean())
            yield row


def with_ends(
    ours: mm.Model, theirs: mm.Model, pair: MuscleHomology, ends: tuple[int, ...]
) -> mm.Model:
    """Return our muscles with the ends (0 first, -1 last) of the anatomist's.

    Of several parts they are those of the middle one.
    """
    given = theirs.muscle(pair.targets[len(pair.targets) // 2]).path.points
    muscles = []
    for one in ours.muscles:
        points = list(one.path.points)
        if one.name in pair.sources:
            for end in ends:
                points[end] = given[end]
        muscles.append(replace(one, path=replace(one.path, points=tuple(points))))
    return replace(ours, muscles=tuple(muscles))


def measure_alignment(data: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each segment.

    It has how the anatomist's frames were laid on the bones, and how far that can be trusted.
    """
    if not (data / ANATOMIST).exists() or not (data / "mouse-skeleton-keypoints").exists():
        return
    model = mouse_hindlimb_model(data / ANATOMIST)
    bodies = mouse(data)
    ground = on_skeleton(data)
    laid = Alignment(model, bodies.model, surfaces=bodies.surfaces)
    there = Posed(bodies.model, {})
    for body, (target, _, far) in SEGMENTS.items():
        if body == "Torso":
            continue
        one = laid.similarity(body)
        shape = laid.shape(body)
        ends = one.apply(laid.attachments(body))
        moved = laid.onto_bone(body, one)
        points = [p.location for m in model.muscles for p in m.path.points if p.body == body]
        depth = np.abs(shape.signed(one.apply(np.array(points)))) / ground.lengths[target]
        turned = there.within(target, "mouse").rotation @ one.rotation @ MOUSE_AXES.T
        angle = np.degrees(np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0)))
        yield {
            "segment": body,
            "laid by": (
                "two joints and the flexion axis"
                if far
                else "one joint, the frames and the leg's size"
            ),
            "bone length [mm]": 1e3 * ground.lengths[target],
            "times the anatomist's": one.scale,
            "frames differ by [deg]": f"{angle:.1f}" if far else "taken as the same",
            "muscle points": len(points),
            "from the bone, median / worst [%]": percent(list(depth)),
            "attachments from the bone [%]": percent(
                list(np.abs(shape.signed(ends)) / ground.lengths[target])
            ),
            "moved onto it by [%]": 100.0 * float(np.linalg.norm(moved)) / ground.lengths[target],
            "then [%]": percent(list(np.abs(shape.signed(ends + moved)) / ground.lengths[target])),
        }
    yield {
        "segment": "Pelvis, by both hips and the lumbosacral joint",
        "laid by": "three joints",
        "bone length [mm]": 1e3 * ground.lengths["mouse"],
        "times the anatomist's": (
            Alignment(model, bodies.model, "pelvis by joints").similarity("Pelvis").scale
        ),
        "frames differ by [deg]": "",
        "muscle points": "",
        "from the bone, median / worst [%]": (
            f"joints stay {100 * laid.residual() / ground.lengths['mouse']:.0f} apart"
        ),
    }
