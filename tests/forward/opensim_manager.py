"""OpenSim's own forward dynamics, integrated by its Manager in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np


def opensim_forward(model, folder, *, changes=(), **wanted):
    """Coordinates (frames, coordinates) by OpenSim's Manager, and the model as it was run.

    `changes`: of the model before, "rigid" or "elastic" muscles of De Groote and others, "contact";
    `wanted`: `seconds`, `rate`, `accuracy`, `start` {coordinate: (value, speed)}, `controls`
    {muscle: [[time, value], ...]}.
    """
    folder = Path(folder)
    work = folder / "wanted.json"
    work.write_text(json.dumps({"model": str(model), "changes": list(changes), **wanted}))
    subprocess.run([sys.executable, __file__, str(work)], check=True, cwd=folder)
    done = np.load(folder / "done.npz")
    return {name: done[name] for name in done.files}, folder / "ran.osim"


def _changed(opensim, model, change):
    if change in ("rigid", "elastic"):
        opensim.DeGrooteFregly2016Muscle.replaceMuscles(model)
        for k in range(model.getMuscles().getSize()):
            muscle = model.getMuscles().get(k)
            muscle.set_ignore_tendon_compliance(change == "rigid")
            muscle.set_ignore_activation_dynamics(False)
    if change == "undamped":
        for k in range(model.getMuscles().getSize()):
            muscle = opensim.Millard2012EquilibriumMuscle.safeDownCast(model.getMuscles().get(k))
            muscle.set_fiber_damping(0.0)
    if change == "no muscles":
        forces = model.updForceSet()
        for k in reversed(range(forces.getSize())):
            if opensim.Muscle.safeDownCast(forces.get(k)) is not None:
                forces.remove(k)


def _ball(opensim, law):
    """Make a free ball that falls on a plane."""
    model = opensim.Model()
    ball = opensim.Body("ball", 1.5, opensim.Vec3(0.0), opensim.Inertia(0.01))
    model.addBody(ball)
    model.addJoint(opensim.FreeJoint("free", model.getGround(), ball))
    down = opensim.Vec3(0.0, 0.0, -0.5 * np.pi)
    plane = opensim.ContactHalfSpace(opensim.Vec3(0.0), down, model.getGround(), "plane")
    sphere = opensim.ContactSphere(0.1, opensim.Vec3(0.0), ball, "sphere")
    model.addContactGeometry(plane)
    model.addContactGeometry(sphere)
    force = opensim.SmoothSphereHalfSpaceForce("contact", sphere, plane)
    for name, value in law.items():
        getattr(force, f"set_{name}")(value)
    model.addForce(force)
    return model, (ball, plane, sphere, force)


def _made(opensim, wanted):
    """Make or read the model, with what it owns."""
    if wanted["model"] == "ball":
        return _ball(opensim, wanted["law"])
    return opensim.Model(wanted["model"]), ()


def _controlled(opensim, model, controls):
    """Give muscles their excitations; what must be held on to."""
    if not controls:
        return []
    controller = opensim.PrescribedController()
    kept = [controller]
    for name, samples in controls.items():
        controller.addActuator(model.getMuscles().get(name))
        function = opensim.PiecewiseLinearFunction()
        for time, value in samples:
            function.addPoint(time, value)
        controller.prescribeControlForActuator(name, function)
        kept.append(function)
    model.addController(controller)
    return kept


def _run(wanted, folder):
    import opensim

    opensim.Logger.setLevelString("Off")
    model, owned = _made(opensim, wanted)
    for change in wanted["changes"]:
        _changed(opensim, model, change)
    model.finalizeConnections()
    model.printToXML(str(folder / "ran.osim"))
    # OpenSim's objects go where nothing holds them.
    controls = wanted.get("controls") or {}
    kept = [*owned, *_controlled(opensim, model, controls)]
    state = model.initSystem()
    coordinates = model.getCoordinateSet()
    names = [coordinates.get(k).getName() for k in range(coordinates.getSize())]
    for name, (value, speed) in wanted.get("start", {}).items():
        coordinates.get(name).setValue(state, value, False)
        coordinates.get(name).setSpeedValue(state, speed)
    for name, samples in controls.items():
        model.getMuscles().get(name).setActivation(state, samples[0][1])
    model.equilibrateMuscles(state)
    manager = opensim.Manager(model)
    manager.setIntegratorAccuracy(wanted.get("accuracy", 1e-9))
    manager.initialize(state)
    count = round(wanted["seconds"] * wanted["rate"])
    values = np.empty((count + 1, len(names)))
    forces = np.empty((count + 1, model.getMuscles().getSize()))
    for frame in range(count + 1):
        if frame:
            state = manager.integrate(frame / wanted["rate"])
        model.realizeDynamics(state)
        values[frame] = [coordinates.get(name).getValue(state) for name in names]
        forces[frame] = [
            model.getMuscles().get(k).getTendonForce(state) for k in range(forces.shape[1])
        ]
    assert kept is not None
    np.savez(folder / "done.npz", names=np.array(names), values=values, forces=forces)


if __name__ == "__main__":
    given = Path(sys.argv[1])
    _run(json.loads(given.read_text()), given.parent)
