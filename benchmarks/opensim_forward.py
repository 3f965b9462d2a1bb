"""OpenSim's own fiber dynamics, each muscle on a slider.

They are integrated under known activations and path lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, interp1d

from myomorph.core.model.arrays import Array

opensim.Logger.setLevelString("Off")

STATES = ("fiber_length", "normalized_tendon_force")


class SliderMuscles:
    """The muscles of a model on sliders.

    `forces_state`: (muscles,) whether a muscle's state is its normalized tendon force, rather than
    its fiber length.
    """

    def __init__(self, model_path: Path, muscles: tuple[str, ...]):
        # References are kept: OpenSim's objects go with the model that owns them.
        self._source = opensim.Model(str(model_path))
        self._model = opensim.Model()
        self._model.setGravity(opensim.Vec3(0.0))
        self._joints = []
        self._muscles = []
        self._names = muscles
        for name in muscles:
            self._add(name)
        self._state = self._model.initSystem()
        self._coordinates = [joint.getCoordinate(0) for joint in self._joints]
        self._paths = [self._state_of(name) for name in muscles]
        self.forces_state = np.array([path.endswith(STATES[1]) for path in self._paths])

    def _add(self, name: str) -> None:
        body = opensim.Body(f"body_{name}", 1.0, opensim.Vec3(0.0), opensim.Inertia(1.0))
        self._model.addBody(body)
        joint = opensim.SliderJoint(f"slider_{name}", self._model.getGround(), body)
        self._model.addJoint(joint)
        muscle = self._source.getMuscles().get(name).clone()
        muscle.set_path(opensim.GeometryPath())
        muscle.addNewPathPoint("origin", self._model.getGround(), opensim.Vec3(0.0))
        muscle.addNewPathPoint("insertion", body, opensim.Vec3(0.0))
        self._model.addForce(muscle)
        self._joints.append(joint)
        self._muscles.append(muscle)

    def _state_of(self, name: str) -> str:
        names = self._model.getStateVariableNames()
        every = [names.get(k) for k in range(names.getSize())]
        return next(one for one in every for ending in STATES if one.endswith(f"/{name}/{ending}"))

    def rates(
        self, lengths: Array, speeds: Array, activations: Array, states: Array
    ) -> tuple[Array, Array]:
        """Return derivatives of the states, and tendon forces.

        Parameters
        ----------
        lengths : (muscles,) of the paths [m]
        speeds : (muscles,) of the paths [m/s]
        activations : (muscles,)
        states : (muscles,)

        Returns
        -------
        (muscles,) derivatives, and (muscles,) forces [N]
        """
        state = self._state
        model = self._model
        for k, muscle in enumerate(self._muscles):
            self._coordinates[k].setValue(state, float(lengths[k]), False)
            self._coordinates[k].setSpeedValue(state, float(speeds[k]))
            muscle.setActivation(state, float(activations[k]))
            model.setStateVariableValue(state, self._paths[k], float(states[k]))
        model.realizeAcceleration(state)
        rates = np.array([model.getStateVariableDerivativeValue(state, one) for one in self._paths])
        return rates, np.array([muscle.getTendonForce(state) for muscle in self._muscles])


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMotion:
    """How the paths of muscles move.

    Attributes
    ----------
    time : (frames,) [s]
    lengths : (frames, muscles) [m], cubic between frames
    speeds : (frames, muscles) [m/s]
    """

    time: Array
    lengths: Array
    speeds: Array


def forward_forces(
    sliders: SliderMuscles, paths: PathMotion, activations: Array, start: Array
) -> Array:
    """Integrate OpenSim's muscles, and return their tendon forces.

    Parameters
    ----------
    sliders : the muscles
    paths : their motion
    activations : (frames - 1, muscles) in the middle between frames, straight between them
    start : (muscles,) states at the first frame

    Returns
    -------
    (frames, muscles) [N]
    """
    time = paths.time
    length = CubicHermiteSpline(time, paths.lengths, paths.speeds)
    clock = np.concatenate([time[:1], 0.5 * (time[1:] + time[:-1]), time[-1:]])
    held = np.concatenate([activations[:1], activations, activations[-1:]])
    activation = interp1d(clock, held, axis=0)
    speed = length.derivative()

    def rates(t: float, states: Array) -> Array:
        t = min(max(t, time[0]), time[-1])
        return sliders.rates(length(t), speed(t), activation(t), states)[0]

    # A muscle's state does not know of the others': the Jacobian is diagonal.
    found = solve_ivp(
        rates,
        (time[0], time[-1]),
        start,
        "LSODA",
        time,
        rtol=1e-7,
        atol=1e-8,
        lband=0,
        uband=0,
        max_step=0.01,
    )
    at = zip(paths.lengths, paths.speeds, activation(time), found.y.T, strict=True)
    return np.array([sliders.rates(*one)[1] for one in at])
