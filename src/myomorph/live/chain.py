"""The chain while frames arrive: pose, torques and tensions of one frame.

They come from what has arrived until then.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from myomorph.core.contact.assign import OnlineFeet
from myomorph.core.contact.site_motion import OnlineFootPath, root_places
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.movement import MOVEMENTS, Movement
from myomorph.core.motion.causal import CausalFilter, CausalStream
from myomorph.core.motion.cutoff_choice import MOVEMENT_CUTOFFS, USUAL
from myomorph.core.motion.measurements import default_markers
from myomorph.core.motion.online import (
    BLEND,
    OnlineKinematics,
    OnlineOrientations,
    SteadyFrame,
    SteadyKinematics,
)
from myomorph.core.motion.sensors.mounting import SensorMounting
from myomorph.core.rigid.dynamics import OnlineDynamics
from myomorph.core.tension.dual import MISSING, OPTIMAL
from myomorph.core.tension.online import OnlineTension, TensionFrame
from myomorph.core.tension.recruitment import RecruitmentOptions
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.actuators import floating_joints
from myomorph.lab.uncertainty.sources import Sources
from myomorph.live.limits import DrawnChain, FrameLimits, Instant, LimitOptions, LiveLimits
from myomorph.live.loop import GAP, HELD, NO_FORCE, SETTLING, SOLVED, UNSOLVED
from myomorph.live.sources import Source

KEPT = 2.0  # Forces that no frame has asked for are kept so long [s].


@dataclass(frozen=True)
class ChainOptions:
    """How the chain works while frames arrive.

    Attributes
    ----------
    cutoff : half-power frequency of the filter of coordinates and forces [Hz], whose delay is 0.336
        / cutoff; by default 12 Hz for running and jumping, else 6 Hz
    movement : kind of movement, which determines the filter if no cutoff is given
    blend : time constant with which the jump at a lost or found marker decays [s]
    max_age : maximum age of a frame [s]; older frames are dropped, so that the latency stays
        bounded
    joint_load : weight of the squared knee contact force, in body weights, relative to the effort
        of one muscle; 0 for none; by default that of 'myomorph tension'
    """

    cutoff: float | None = None
    movement: Movement | None = None
    blend: float = BLEND
    max_age: float = 0.1
    joint_load: float | None = None

    def __post_init__(self) -> None:
        if self.movement is not None:
            check_name("movement", self.movement, MOVEMENTS, where="Myomorph")
        for name in ("cutoff", "blend", "max_age"):
            value = getattr(self, name)
            if value is not None and not (value > 0.0 and np.isfinite(value)):
                raise BadData(f"{name} {getattr(self, name):g}: expected above 0")
        # Errors of the weight are found where it is given.
        RecruitmentOptions(joint_load=self.joint_load)

    @property
    def used_cutoff(self) -> float:
        """Half power of the filter, as stated or usual for the movement [Hz].

        It is known before the first frame comes, so that nothing changes its delay later.
        """
        if self.cutoff is not None:
            return self.cutoff
        return USUAL if self.movement is None else MOVEMENT_CUTOFFS.get(self.movement, USUAL)

    @property
    def recruitment(self) -> RecruitmentOptions:
        """Costs beside the effort."""
        return RecruitmentOptions(joint_load=self.joint_load)


@read_only
class ChainFrame:
    """What one frame gives; everything filtered is of `time` less the filter's delay."""

    time: float  # of the newest frame [s]
    pose: Array  # (coordinates,) as the markers show it, not filtered
    # coordinates, velocities: (coordinates,) filtered
    coordinates: Array
    velocities: Array
    torques: Array  # (coordinates,) [N m or N]
    tension: TensionFrame  # what the torques are shared into
    wrenches: Array  # (bodies, 6) external moment about the ground's origin and force [N m], [N]
    error: float  # of the markers [m]
    seen: int  # markers that are
    owed: float  # jump that is still to be given back, as of `SteadyFrame`
    state: int  # index into `STATES`
    # of coordinates, torques and tensions, None where unknown or not asked for
    limits: FrameLimits | None = None


class Poses:
    """The pose of each frame.

    It is found by inverse kinematics of its markers (`marker_names`: those that model and source
    share) or of its sensors, whose mounting is known, or its coordinates are taken as they come.
    `blend` is the time constant with which the jump of a lost or found marker is given back [s].
    """

    def __init__(
        self,
        model: Model,
        source: Source,
        blend: float | None = None,
        mounting: SensorMounting | None = None,
    ):
        self._model = model
        self._names = source.names
        self._blend = blend
        self._mounting = mounting
        self._rest = np.array([coordinate.default for coordinate in model.coordinates])
        self._kinematics = self._solver() if source.markers or mounting is not None else None
        self._path = OnlineFootPath(model) if mounting is not None and root_places(model) else None
        self.marker_names = () if self._kinematics is None else self._kinematics.marker_names
        self._columns = list[int]()
        if mounting is not None:
            self._columns = [
                index_of("sensor", name, source.names, "the source") for name in mounting.sensors
            ]
        elif not source.markers:
            self._columns = [
                index_of("coordinate", name, model.coordinate_names) for name in source.names
            ]

    def _solver(self) -> SteadyKinematics | OnlineKinematics:
        if self._mounting is not None:
            return OnlineOrientations(self._model, self._mounting)
        if self._blend is None:
            return OnlineKinematics(self._model, self._names)
        return SteadyKinematics(self._model, self._names, blend=self._blend)

    def warm_up(self) -> None:
        """Solve the default pose with a solver of its own, with all markers and with one lost."""
        if self._kinematics is None:
            return
        solver = self._solver()
        if self._mounting is not None:
            still = np.tile([1.0, 0.0, 0.0, 0.0], (len(self._columns), 1))
            solver.solve(0.0, still)
            solver.solve(0.01, still)
            return
        tracked = [self._names.index(name) for name in solver.marker_names]
        positions = np.full((len(self._names), 3), np.nan)
        positions[tracked] = default_markers(self._model, solver.marker_names)
        solver.solve(0.0, positions)
        positions[tracked[0]] = np.nan
        solver.solve(0.01, positions)

    def solve(self, time: float, row: Array) -> SteadyFrame:
        """Solve the pose of a frame.

        Parameters
        ----------
        time : of the frame [s]
        row : markers (markers, 3) [m], quaternions (sensors, 4), or coordinates (coordinates,) of
            the source's names [rad or m]

        Returns
        -------
        The pose with its error
        """
        if isinstance(self._kinematics, OnlineOrientations):
            quaternions = row[self._columns]
            coordinates, _ = self._kinematics.solve(time, quaternions)
            seen = int(np.isfinite(quaternions).all(axis=1).sum())
            placed = coordinates if self._path is None else self._path.placed(coordinates)
            return SteadyFrame(
                coordinates=placed, error=float("nan"), seen=seen, held=False, owed=0.0
            )
        if isinstance(self._kinematics, SteadyKinematics):
            return self._kinematics.solve(time, row)
        if self._kinematics is not None:
            coordinates, error = self._kinematics.solve(time, row)
            return SteadyFrame(
                coordinates=coordinates,
                error=error,
                seen=int(np.isfinite(row).all(axis=1).sum()),
                held=False,
                owed=0.0,
            )
        pose = self._rest.copy()
        pose[self._columns] = row
        return SteadyFrame(coordinates=pose, error=float("nan"), seen=0, held=False, owed=0.0)


class LiveChain:
    """The chain from markers and forces to coordinates, torques, activations.

    Parameters
    ----------
    limits : how interval bounds of results are drawn, with errors of the sizes `sources`; None for
        no bounds
    mounting : of the source's inertial sensors, None for none

    Attributes
    ----------
    filter_delay : how much older torques and tensions are than their frame [s]
    max_age : maximum age of a frame [s]; older frames are dropped, so that the latency stays
        bounded
    bodies : that external forces act on
    """

    def __init__(
        self,
        model: Model,
        source: Source,
        options: ChainOptions | None = None,
        tension: TensionOptions | None = None,
        limits: LimitOptions | None = None,
        sources: Sources | None = None,
        mounting: SensorMounting | None = None,
    ):
        self.model = model
        self.options = options or ChainOptions()
        self.filter = CausalFilter(self.options.used_cutoff)
        self.filter_delay = self.filter.delay
        self.max_age = self.options.max_age
        self.poses = Poses(model=model, source=source, blend=self.options.blend, mounting=mounting)
        self.feet = OnlineFeet(model, source.plates, source.bodies)
        self.bodies = self.feet.bodies
        self.dynamics = OnlineDynamics(model, self.bodies)
        self.tension = OnlineTension(model, tension, recruitment=self.options.recruitment)
        self.actuators = self.tension.actuators
        count = len(model.coordinates)
        self._motion = CausalStream(self.filter, count)
        self._forces = CausalStream(self.filter, 6 * len(self.bodies))
        self._force_rate = source.force_rate
        self._waiting: deque[tuple[float, Array]] = deque()
        self._pose: Array | None = None
        self._unknown = -np.inf
        self._rest = np.array([coordinate.default for coordinate in model.coordinates])
        nothing = np.full(len(model.muscles), np.nan)
        no_reserves = np.full(len(self.actuators), np.nan)
        no_torques = np.full(len(self.tension.coordinates), np.nan)
        self._unshared = TensionFrame(
            activations=nothing,
            forces=nothing,
            reserves=no_reserves,
            balanced=no_torques,
            status=MISSING,
            equilibrium_residual=float("nan"),
        )
        self._names = source.names if source.markers else None
        self.limits: LiveLimits | None = None
        if limits is not None and limits.draws and mounting is not None:
            raise BadData(
                "limits while frames arrive are of markers and coordinates: ik --imu FILE --draws"
                " has those"
            )
        if limits is not None and limits.draws:
            self.limits = LiveLimits(
                model,
                DrawnChain(
                    names=self._names,
                    bodies=self.bodies,
                    filter=self.filter,
                    rate=source.rate,
                    up=self.feet.up,
                ),
                options=limits,
                sources=sources,
                tension=tension,
                recruitment=self.options.recruitment,
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """What is assumed, and how long plates were loaded near no foot so far, one line each."""
        missed = tuple(
            f"plate '{name}' was loaded for {count / self._force_rate:.2f} s near no foot: that"
            " force was left out"
            for name, count in zip(self.feet.plates, self.feet.nobody.tolist(), strict=True)
            if count > 0.02 * self._force_rate
        )
        if self.limits is not None:
            missed += self.limits.notes
        floating = floating_joints(self.model)
        if self._force_rate or not floating:
            return missed
        text = "is a residual, and torques are those of a body that nothing supports"
        return (f"no external forces: what supports '{floating[0].child}' {text}", *missed)

    def warm_up(self) -> None:
        """Compute everything once on the default pose.

        So nothing is compiled when the first frame comes.
        """
        self.poses.warm_up()
        if self._force_rate:
            self.feet.given(np.zeros((1, len(self.feet.plates), 6)), None)
        for stream, width in (
            (self._motion, len(self._rest)),
            (self._forces, 6 * len(self.bodies)),
        ):
            stream.push(np.array([0.0, 0.01]), np.zeros((2, width)))
            stream.at(10.0)
            stream.forget()
        still = np.zeros_like(self._rest)
        self.dynamics.solve(self._rest, still, still, np.zeros((len(self.bodies), 6)))
        self.tension.solve_after(self.dynamics)
        if self.limits is not None:
            row = np.full((len(self._names or ()), 3), np.nan)
            motion = np.zeros((4, len(self._rest)))
            loads = np.zeros((3, len(self.bodies), 6))
            motion[0] = self._rest
            self.limits.warm_up(
                Instant(
                    time=0.0,
                    pose=self._rest.copy(),
                    row=row,
                    motion=motion,
                    loads=loads,
                    result=np.zeros(0),
                )
            )

    @property
    def newest_force(self) -> float:
        """Time of the newest sample of force that has come, -inf before there is one [s]."""
        if self._waiting:
            return self._waiting[-1][0]
        last = self._forces.last
        return last if np.isfinite(last) else -np.inf

    def push_forces(self, time: Array, wrenches: Array) -> None:
        """Add samples of the plates, for frames to come.

        Parameters
        ----------
        time : (samples,) [s]
        wrenches : (samples, plates, 6) moment about the ground's origin [N m] and force [N]
        """
        if not len(time) or not self.bodies:
            return
        self._waiting.extend(zip(time.tolist(), wrenches, strict=True))
        while self._waiting and self._waiting[-1][0] - self._waiting[0][0] > KEPT:
            self._waiting.popleft()

    def restart(self) -> None:
        """Begin anew with the next frame: nothing is known of the motion before it."""
        self._motion.forget()
        self._forces.forget()
        self._waiting.clear()

    def _forces_at(self, time: float) -> Array | None:
        """(bodies, 6) filtered wrenches at a time, None where they are not known."""
        if not self._force_rate:
            return np.zeros((len(self.bodies), 6))
        arrived = []
        while self._waiting and self._waiting[0][0] <= time:
            arrived.append(self._waiting.popleft())
        if arrived:
            times, rows = map(np.array, zip(*arrived, strict=True))
            self._forces.push(times, self.feet.given(rows, self._pose).reshape(len(times), -1))
        if not time - self._forces.last <= GAP:
            self._forces.forget()
            return None
        placed = self._forces.at(time)[0]
        return placed.reshape(-1, 6) if np.isfinite(placed).all() else None

    def frame(self, time: float, row: Array) -> ChainFrame:
        """Compute one frame.

        Parameters
        ----------
        time : of the frame [s]
        row : markers (markers, 3) [m], or coordinates (coordinates,) of the source's names
            [rad or m]

        Returns
        -------
        Pose, torques and tensions, with interval bounds where they are known
        """
        steady = self.poses.solve(time, row)
        pose = steady.coordinates
        self._motion.push(np.array([time]), pose[None])
        self._pose = pose if np.isfinite(pose).all() else self._pose
        wrenches = self._forces_at(time)
        value, velocity, acceleration = self._motion.at(time)
        state = self._state(time, steady.held, value, wrenches)
        if wrenches is None:
            wrenches = np.full((len(self.bodies), 6), np.nan)
        torques = np.full(len(self._rest), np.nan)
        shared = self._unshared
        if state == SOLVED:
            torques = self.dynamics.solve(value, velocity, acceleration, wrenches).copy()
            # Values of coordinates that follow others are those of the filtered leaders.
            value = self.dynamics.coordinates[0]
            velocity = self.dynamics.rates[0]
            shared = self.tension.solve_after(self.dynamics)
            state = SOLVED if shared.status == OPTIMAL else UNSOLVED
        limits = None
        if self.limits is not None and state in (SOLVED, SETTLING):
            result = np.concatenate([value, torques, shared.activations, shared.forces])
            limits = self.limits.at(time, result) if state == SOLVED else None
            if self.limits.due(time):
                loads = np.zeros((3, len(self.bodies), 6))
                if self._force_rate:
                    loads[:] = self._forces.at(time).reshape(loads.shape)
                derivatives = self._motion.derivatives(time)
                self.limits.offer(
                    Instant(
                        time=time,
                        pose=pose.copy(),
                        row=np.array(row),
                        motion=derivatives,
                        loads=loads,
                        result=result,
                    )
                )
        return ChainFrame(
            time=time,
            pose=pose,
            coordinates=value.copy(),
            velocities=velocity.copy(),
            torques=torques,
            tension=shared,
            wrenches=wrenches,
            error=steady.error,
            seen=steady.seen,
            owed=steady.owed,
            state=state,
            limits=limits,
        )

    def idle(self) -> bool:
        """Draw limits."""
        return self.limits is not None and self.limits.idle()

    def _state(self, time: float, held: bool, value: Array, wrenches: Array | None) -> int:
        """Whether torques can be known."""
        if held:
            self._unknown = time
            return HELD
        if not np.isfinite(value).all():
            return SETTLING
        # The way from where the body was held to where it is found is no motion of the subject.
        if time - self._unknown < self.filter.settling:
            return HELD
        return SOLVED if wrenches is not None else NO_FORCE
