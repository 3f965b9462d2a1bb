"""Lengths, lengthening velocities and moment arms of a model's muscles in a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import DEFAULT_POSE, Motion
from myomorph.core.model.shapes import ArmPairs, FrameValues, MomentArmTable, MuscleValues
from myomorph.core.model.shown import shown
from myomorph.core.muscles.coupled_arms import LoopGroup, loop_couplings, loop_groups
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.muscles.path_arrays import ARMS
from myomorph.core.muscles.path_frame import slopes_of_couplers
from myomorph.core.muscles.quantities import MOMENT_ARM, MUSCLE_VELOCITY, PATHS
from myomorph.core.rigid.coordinates import Ints

AT_ONCE = 64  # Frames whose moment arms stand in one dense table


@shown
@dataclass(frozen=True, eq=False)
class MuscleKinematics(Labelled):
    """Lengths, velocities and moment arms of muscles over time.

    Attributes
    ----------
    time : (frames,) [s]
    muscles, coordinates : names
    muscle_length : (frames, muscles) of the muscle-tendon units [m]
    muscle_velocity : (frames, muscles) or None where not requested [m/s]
    arms : (frames, pairs) packed, of the pairs that `paths` lists, or None where not requested;
        `moment_arm` has (frames, muscles, coordinates)
    coupler_slopes : (frames, couplers, 2) of the dependent coordinates in those they follow
    paths : the compiled paths, which hold the pattern of `arms`
    loops : of each group of coordinates that closed loops tie together, `loop_couplings`
    """

    time: FrameValues
    muscles: tuple[str, ...]
    coordinates: tuple[str, ...]
    muscle_length: MuscleValues
    muscle_velocity: MuscleValues | None
    arms: ArmPairs | None
    coupler_slopes: Array
    paths: Paths = field(repr=False)
    loops: tuple[tuple[LoopGroup, Array], ...] = field(default=(), repr=False)

    @property
    def held(self) -> tuple[Quantity, ...]:
        """Lengths, and velocities and moment arms where they were requested."""
        absent = [
            quantity
            for quantity, values in (
                (MUSCLE_VELOCITY, self.muscle_velocity),
                (MOMENT_ARM, self.arms),
            )
            if values is None
        ]
        return tuple(quantity for quantity in PATHS if quantity not in absent)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], muscles, coordinates.

        Returns
        -------
        by dimension
        """
        return {"time": self.time, "muscle": self.muscles, "coordinate": self.coordinates}

    @property
    def moment_arm(self) -> MomentArmTable:
        """(frames, muscles, coordinates) all moment arms; see `dense`."""
        return self.dense()

    def dense(self, frames: slice = slice(None)) -> MomentArmTable:
        """Moment arms as OpenSim reports them.

        A coordinate that others follow has what reaches the muscle through them included. One that
        follows has the moment arm of what it follows per unit of its own motion: with d = f(q) and
        slope g, r_d = r_q / g; where g is 0, its own share. Coordinates of a closed loop have what
        the others of the loop add while they follow; see `coupled_arms`.

        Parameters
        ----------
        frames : of the motion; big models are read in parts

        Returns
        -------
        (frames, muscles, coordinates) [m/rad or m/m]

        Raises
        ------
        BadData : moment arms were not requested
        """
        return self._dense(frames, np.arange(len(self.muscles)))

    def moment_arm_of(self, muscle: str, coordinate: str) -> FrameValues:
        """Moment arm of one muscle about one coordinate, as of `dense`.

        Parameters
        ----------
        muscle, coordinate : their names

        Returns
        -------
        (frames,) [m/rad or m/m]

        Raises
        ------
        UnknownName : there is no such muscle or coordinate
        """
        i = index_of("muscle", muscle, self.muscles)
        j = index_of("coordinate", coordinate, self.coordinates)
        return self._dense(slice(None), np.array([i]))[:, 0, j]

    def independent(self, frames: slice = slice(None)) -> tuple[Array, Ints, Ints]:
        """Moment arms about independent coordinates, each moved alone, loops opened; sparse.

        Parameters
        ----------
        frames : of the motion

        Returns
        -------
        values : (frames, pairs) [m/rad or m/m]
        muscle, coordinate : (pairs,) indices
        """
        free = self.paths.arm_free
        return (
            self._arms()[frames][:, free],
            self.paths.arm_muscle[free],
            self.paths.arm_coordinate[free],
        )

    def _arms(self) -> ArmPairs:
        """Packed moment arms; `BadData` where they were not requested."""
        if self.arms is None:
            raise BadData(
                "these muscle kinematics were made without moment arms: ask for moment_arms=True"
            )
        return self.arms

    def _dense(self, frames: slice, muscles: Ints) -> MomentArmTable:
        """Moment arms as of `dense`, of some muscles.

        Parameters
        ----------
        muscles : (muscles,) their numbers

        Returns
        -------
        (frames, muscles, coordinates) [m/rad or m/m]
        """
        arms = self._arms()[frames]
        starts = self.paths.arrays.start[:, ARMS]
        table = np.zeros((len(arms), len(muscles), len(self.coordinates)))
        for row, m in enumerate(muscles):
            pairs = slice(starts[m], starts[m + 1])
            table[:, row, self.paths.arm_coordinate[pairs]] = arms[:, pairs]
        tree = self.paths.tree.arrays
        # Of d = f(q_1, q_2) with slopes g_1, g_2, the nearest motion has r_d = g . r / g . g.
        for coupler, dependent in enumerate(tree.coupler_coordinate):
            slopes = self.coupler_slopes[frames, coupler]
            reached = np.zeros(table.shape[:2])
            for slope, source in zip(slopes.T, tree.coupler_source[coupler], strict=True):
                if source >= 0:
                    reached += slope[:, None] * table[:, :, source]
            square = (slopes**2).sum(axis=1)
            moves = square > 0.0
            table[moves, :, dependent] = reached[moves] / square[moves, None]
        for group, couplings in self.loops:
            led = table[:, :, group.coordinates[group.leading]]
            table[:, :, group.coordinates] = np.einsum("fml,flk->fmk", led, couplings[frames])
        return table


def muscle_kinematics(
    model: Model,
    motion: Motion,
    velocities: bool = True,
    moment_arms: bool = True,
    progress: Callable[[int], None] | None = None,
) -> MuscleKinematics:
    """Lengths, lengthening velocities and moment arms of a model's muscles in a motion.

    Source: Delp and Loan 1995, paths; Seth et al. 2018, moment arms.

    Parameters
    ----------
    model : with muscles
    motion : coordinates over time; what it lacks stands at the model's default, at rest
    velocities : also lengthening velocities, for which the motion must have velocities
    moment_arms : also moment arms, (frames, pairs of a muscle and a coordinate that moves it)
    progress : called with the number of frames just done

    Returns
    -------
    lengths (frames, muscles) [m], velocities (frames, muscles) [m/s] and moment arms (frames,
    muscles, coordinates) [m]

    Raises
    ------
    BadData : velocities are asked for and the motion has none, or a value is not finite

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> found = mm.muscle_kinematics(model, mm.read_motion("reach.mot", model), velocities=False)
    >>> found.muscles, found.muscle_length.shape
    (('flexor', 'extensor'), (61, 2))
    >>> found.moment_arm_of("flexor", "elbow_flexion").shape
    (61,)
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    paths = compile_paths(model)
    if velocities and motion.velocities is None:
        raise BadData(
            "lengthening velocities need the velocities of the coordinates: differentiate the"
            " motion first"
        )
    coordinates = paths.tree.coordinates_of(motion)
    speeds = paths.tree.rates_of(motion)[0] if velocities else None
    known_speeds = speeds is None or np.isfinite(speeds).all()
    if not np.isfinite(coordinates).all() or not known_speeds:
        raise BadData("the motion has values that are not finite")
    lengths, lengthening, arms = paths.evaluate(coordinates, speeds, progress)
    slopes = np.zeros((len(coordinates), len(paths.tree.arrays.coupler_coordinate), 2))
    slopes_of_couplers(paths.arrays, coordinates, slopes)
    loops = tuple(
        (group, loop_couplings(paths.tree, group, coordinates))
        for group in loop_groups(paths.tree)
        if moment_arms
    )
    return MuscleKinematics(
        time=motion.time,
        muscles=model.muscle_names,
        coordinates=model.coordinate_names,
        muscle_length=lengths,
        muscle_velocity=lengthening if velocities else None,
        arms=arms if moment_arms else None,
        coupler_slopes=slopes,
        paths=paths,
        loops=loops,
    )


def default_path_lengths(model: Model) -> Array:
    """Lengths of a model's muscle paths in its default pose.

    Given to `calibrate` as `path_lengths`, it lets fibers and tendons keep their ratio to the path.

    Parameters
    ----------
    model : with muscles

    Returns
    -------
    (muscles,) [m]

    Raises
    ------
    BadModel : where closed loops do not close

    Examples
    --------
    >>> import myomorph as mm
    >>> mm.default_path_lengths(mm.read_model("arm.osim")).round(2).tolist()
    [0.28, 0.24]
    """
    return muscle_kinematics(
        model, DEFAULT_POSE, velocities=False, moment_arms=False
    ).muscle_length[0]


class PathTables(NamedTuple):
    """Muscle paths as tables report them.

    Attributes
    ----------
    lengths : (frames, muscles) [m]
    velocities : (frames, muscles) lengthening [m/s]
    arms : (frames, pairs) moment arms of `ReportedPaths.pairs` [m/rad or m/m]
    """

    lengths: MuscleValues
    velocities: MuscleValues
    arms: Array


class ReportedPaths:
    """Muscle paths of a model as tables report them, a part of a motion at a time.

    Parameters
    ----------
    model : with muscles

    Attributes
    ----------
    pairs : muscle and coordinate of each column of moment arms, in order of coordinates: every pair
        that can have one

    Raises
    ------
    BadModel : the model has no muscles
    """

    def __init__(self, model: Model):
        if not model.muscles:
            raise BadModel(f"model '{model.name}' has no muscles")
        self.model = model
        paths = compile_paths(model)
        crossed = np.zeros((len(model.coordinates), len(model.muscles)), np.bool_)
        crossed[paths.arm_coordinate, paths.arm_muscle] = True
        tree = paths.tree.arrays
        for dependent, sources in zip(tree.coupler_coordinate, tree.coupler_source, strict=True):
            crossed[dependent] |= crossed[sources[sources >= 0]].any(axis=0)
        for group in loop_groups(paths.tree):
            crossed[group.coordinates] = crossed[group.coordinates].any(axis=0)
        self._coordinate, self._muscle = np.nonzero(crossed)
        self.pairs = tuple(
            (model.muscle_names[m], model.coordinate_names[j])
            for m, j in zip(self._muscle, self._coordinate, strict=True)
        )

    def evaluate(
        self, motion: Motion, part: slice, advance: Callable[[int], None] | None = None
    ) -> PathTables:
        """Lengths, velocities and moment arms of some frames of a motion.

        Parameters
        ----------
        motion : with velocities
        part : its frames
        advance : called with the number of frames just done

        Returns
        -------
        tables of as many frames; those without coordinates (NaN) stay NaN
        """
        if motion.velocities is None:
            raise ValueError("the motion has no velocities")
        values = motion.values[part]
        rates = motion.velocities[part]
        unknown = ~(np.isfinite(values) & np.isfinite(rates)).all(axis=1, keepdims=True)
        defaults = {coordinate.name: coordinate.default for coordinate in self.model.coordinates}
        values = np.where(unknown, [defaults.get(name, 0.0) for name in motion.names], values)
        known = Motion(
            time=motion.time[part],
            names=motion.names,
            values=values,
            velocities=np.where(unknown, 0.0, rates),
        )
        kinematics = muscle_kinematics(self.model, known, progress=advance)
        tables = [kinematics.dense(slice(i, i + AT_ONCE)) for i in range(0, len(known), AT_ONCE)]
        arms = np.concatenate([table[:, self._muscle, self._coordinate] for table in tables])
        assert kinematics.muscle_velocity is not None
        return PathTables(
            lengths=np.where(unknown, np.nan, kinematics.muscle_length),
            velocities=np.where(unknown, np.nan, kinematics.muscle_velocity),
            arms=np.where(unknown, np.nan, arms),
        )
