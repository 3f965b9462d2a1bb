"""Stairs as a file, made with known forces.

Steps, cells and recordings into forces on bodies and into tensions.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.channels import read_channels
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadFile
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Markers, Motion, Table
from myomorph.core.model.spatial import Transform
from myomorph.lab.store.contact_store import get_contact_forces
from myomorph.lab.store.results import read_result
from myomorph.lab.store.stored import get_wrenches
from myomorph.lab.study.inputs.contact_file import contact_files, read_contacts, read_stairs
from myomorph.lab.study.inputs.external_forces import read_loads
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study

MASS = 0.025
WEIGHT = MASS * 9.80665
RATE = 500.0
FRAMES = 500
HERE = Transform.identity()

STAIRS = """
[stairs]
{head}
[[step]]
name = "low"
position = [0.0, 0.0, 0.0]
orientation = [-90.0, 0.0, 0.0]
size = [0.02, 0.06]
measures = {measures}
channels = {low}
[[step]]
name = "high"
position = [0.03, 0.01, 0.0]
orientation = [-90.0, 0.0, 0.0]
size = [0.02, 0.06]
measures = {measures}
channels = {high}
[[paw]]
body = "paw"
"""


def animal():
    """Make a trunk over one paw that slides with it: its weight must come through the paw."""
    axes = tuple(
        Axis(
            kind="translation" if i < 3 else "rotation",
            vector=np.eye(3)[i % 3],
            function=linear(1.0),
            coordinates=(name,),
        )
        for i, name in enumerate(("x", "y", "z", "rx", "ry", "rz"))
    )
    names = tuple(axis.coordinates[0] for axis in axes)
    # It ends on the trunk below the paw, so that it pushes the paw down.
    ends = (
        PathPoint("a", "trunk", np.array([0.0, -0.05, 0.0])),
        PathPoint("b", "paw", np.zeros(3)),
    )
    reach = (
        Axis(
            kind="translation",
            vector=np.array([0.0, 1.0, 0.0]),
            function=linear(1.0),
            coordinates=("reach",),
        ),
    )
    return Model(
        name="animal",
        bodies=(
            Body(name="trunk", mass=MASS, mass_center=np.zeros(3), inertia=1e-5 * np.eye(3)),
            Body(name="paw", mass=1e-6, mass_center=np.zeros(3), inertia=1e-9 * np.eye(3)),
        ),
        joints=(
            Joint(
                name="root",
                kind="CustomJoint",
                parent=GROUND,
                child="trunk",
                parent_frame=HERE,
                child_frame=HERE,
                axes=axes,
                coordinates=names,
            ),
            Joint(
                name="limb",
                kind="CustomJoint",
                parent="trunk",
                child="paw",
                parent_frame=HERE,
                child_frame=HERE,
                axes=reach,
                coordinates=("reach",),
            ),
        ),
        coordinates=(
            *(
                Coordinate(name, "translational" if name in "xyz" else "rotational", range=(-9, 9))
                for name in names
            ),
            Coordinate("reach", "translational", range=(-9, 9)),
        ),
        gravity=np.array([0.0, -9.80665, 0.0]),
        muscles=(
            Muscle(
                name="pusher",
                kind="Thelen2003Muscle",
                path=Path(ends),
                max_isometric_force=2.0,
                optimal_fiber_length=0.02,
                tendon_slack_length=0.01,
            ),
        ),
    )


def recording(folder, measures=("fx", "fy", "fz")):
    """Write a recording of the paw on the low step, then on the high one, half of the time each.

    The trunk stands over the paw.
    """
    time = np.arange(FRAMES) / RATE
    low = time < 0.5
    x = np.where(low, 0.002, 0.031)
    y = np.where(low, 0.0, 0.01)
    columns = np.zeros((FRAMES, 7))
    columns[:, 0] = x
    columns[:, 1] = y + 0.02
    columns[:, 6] = -0.02
    model = animal()
    write_sto(Table(time, model.coordinate_names, columns, in_degrees=False), folder / "walk.sto")
    force = np.zeros((FRAMES, 3))
    force[:, 1] = WEIGHT
    force[:, 0] = 0.1 * WEIGHT * np.sin(20.0 * time)
    values = {}
    # In the axes of a tread whose z is y of ground: x stays, y is -z of ground.
    own = {"fx": force[:, 0], "fy": -force[:, 2], "fz": force[:, 1]}
    for step, on in (("low", low), ("high", ~low)):
        for name in measures:
            values[f"{step}_{name}"] = np.where(on, own[name], 0.0) + 0.02
    with (folder / "cells.csv").open("w") as stream:
        stream.write("time," + ",".join(values) + "\n")
        for i, t in enumerate(time):
            stream.write(
                f"{t:.6f}," + ",".join(f"{column[i]:.9f}" for column in values.values()) + "\n"
            )
    return model, Motion(time, model.coordinate_names, columns), force, low


def write(folder, measures=("fx", "fy", "fz"), head='recording = "cells.csv"'):
    quoted = "[" + ", ".join(f'"{one}"' for one in measures) + "]"
    parts = {
        step: "[" + ", ".join(f'"{step}_{one}"' for one in measures) + "]"
        for step in ("low", "high")
    }
    path = folder / "stairs.toml"
    path.write_text(STAIRS.format(head=head, measures=quoted, **parts))
    return path


def test_forces_come_back_on_the_paw(tmp_path):
    model, motion, force, low = recording(tmp_path)
    loads = read_loads(write(tmp_path), model, motion)
    assert sorted(loads.names) == ["high_paw", "low_paw"]
    assert loads.bodies == ("paw", "paw")
    assert not loads.notes
    total = loads.forces.sum(axis=1)
    away = np.abs(loads.time - 0.5) > 0.02
    np.testing.assert_allclose(total[away], force[away], atol=2e-6)
    at = loads.points[:, loads.names.index("low_paw")]
    np.testing.assert_allclose(
        at[low & away], np.tile([0.002, 0.0, 0.0], ((low & away).sum(), 1)), atol=1e-9
    )


def test_the_other_sense_and_the_other_up(tmp_path):
    model, motion, force, _ = recording(tmp_path)
    other = read_loads(
        write(tmp_path, head='recording = "cells.csv"\nforce_on = "step"\ntare = "none"'),
        model,
        motion,
    )
    assert not len(other.names)
    path = write(tmp_path, head='recording = "cells.csv"\nup = "z"')
    path.write_text(
        path.read_text()
        .replace("[-90.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]")
        .replace("[0.03, 0.01, 0.0]", "[0.03, 0.0, 0.01]")
    )
    turned = read_loads(path, model, motion)
    away = np.abs(turned.time - 0.5) > 0.02
    np.testing.assert_allclose(turned.forces.sum(axis=1)[away], force[away], atol=2e-6)


def test_one_axis_is_open_until_it_is_told(tmp_path):
    model, motion, force, _ = recording(tmp_path, ("fz",))
    loads = read_loads(write(tmp_path, ("fz",)), model, motion)
    assert not loads.names
    assert len(loads.notes) == 2
    zero = read_loads(
        write(tmp_path, ("fz",), 'recording = "cells.csv"\nunmeasured = "zero"'), model, motion
    )
    away = np.abs(zero.time - 0.5) > 0.02
    np.testing.assert_allclose(zero.forces.sum(axis=1)[away, 1], force[away, 1], atol=2e-6)
    assert not zero.forces[..., [0, 2]].any()


def test_tensions_find_what_one_axis_leaves_open(tmp_path):
    from myomorph.core.rigid.dynamics import inverse_dynamics
    from myomorph.core.tension.contact_setting import Measurements, set_contacts
    from myomorph.core.tension.solve import solve_tension
    from myomorph.core.tension.tension import TensionOptions
    from myomorph.core.tension.terms.contacts import ContactOptions

    model, motion, _, _ = recording(tmp_path, ("fz",))
    write(tmp_path, ("fz",))
    (tmp_path / "contacts.toml").write_text('stairs = "stairs.toml"\n')
    assert [one.name for one in contact_files(tmp_path / "contacts.toml")] == [
        "contacts.toml",
        "stairs.toml",
        "cells.csv",
    ]
    plan = read_contacts(tmp_path / "contacts.toml", model)
    assert plan.stairs is not None
    still = slice(100, 104)
    part = Motion(
        time=motion.time[still],
        names=motion.names,
        values=motion.values[still],
        velocities=0 * motion.values[still],
        accelerations=0 * motion.values[still],
    )
    setting = set_contacts(plan, model, part, Measurements(part), ContactOptions())
    assert [one.sites for one in setting.task.measured] == [("paw",)]
    assert setting.task.activations.values.min() == 1.0
    torques = inverse_dynamics(model, part)
    solved = solve_tension(model, part, torques, TensionOptions(), contacts=setting.task)
    pressed = solved.contacts.contact_force[:, 0]
    np.testing.assert_allclose(pressed[:, 1], WEIGHT, rtol=2e-3)
    assert np.abs(pressed[:, [0, 2]]).max() < 0.01 * WEIGHT


def test_channels_of_other_files(tmp_path):
    recording(tmp_path)
    cells = read_channels(tmp_path / "cells.csv")
    write_sto(Table(cells.time, cells.names, cells.values), tmp_path / "cells.sto")
    np.testing.assert_allclose(
        read_channels(tmp_path / "cells.sto").values, cells.values, atol=1e-7
    )
    text = (tmp_path / "cells.csv").read_text().replace(",", ";")
    (tmp_path / "semi.csv").write_text(text)
    np.testing.assert_allclose(read_channels(tmp_path / "semi.csv").values, cells.values)
    for name, wrong, told in (
        ("a.csv", "force,other\n1,2\n", "'time' among them"),
        ("b.csv", "time,f\n1,2\n0,3\n", "do not rise"),
        ("c.xyz", "", "expected .c3d, .csv"),
    ):
        (tmp_path / name).write_text(wrong)
        with pytest.raises(BadFile, match=told):
            read_channels(tmp_path / name)


def test_what_is_wrong_is_told_at_once(tmp_path):
    model, motion, _, _ = recording(tmp_path)
    path = write(tmp_path)
    good = path.read_text()
    for old, new, told in (
        ('body = "paw"', 'body = "hoof"', "unknown body 'hoof'"),
        ('recording = "cells.csv"', "", "'recording' is missing"),
        ('recording = "cells.csv"', 'recording = "nothing.csv"', "'nothing.csv' does not exist"),
        ('"low_fz"]', '"low_f"]', "no channel 'low_f'"),
        ('"fz"]', '"fw"]', "expected some of fx"),
        ("size = [0.02, 0.06]", "size = [0.02, 0.0]", "two lengths above 0"),
        (
            "[stairs]",
            "[stairs]\nloaded = 0.01",
            "loaded from 0.01 of body weight and unloaded below 0.02",
        ),
        ("[stairs]", "[stairs]\nfriction = 1", "unknown key 'stairs.friction'"),
    ):
        assert old in good
        path.write_text(good.replace(old, new))
        with pytest.raises(BadFile, match=told):
            read_stairs(path, model)
    path.write_text(good)
    late = Motion(motion.time + 100.0, motion.names, motion.values)
    with pytest.raises(Exception, match="no time in common"):
        read_loads(path, model, late)


def test_a_recording_beside_its_trial(tmp_path):
    model, _, _, _ = recording(tmp_path)
    path = write(tmp_path, head="")
    (tmp_path / "run1_stairs.csv").write_text((tmp_path / "cells.csv").read_text())
    assert read_stairs(path, model, tmp_path / "run1.trc").recording.name == "run1_stairs.csv"
    path = write(tmp_path, head='recording = "{trial}_stairs.csv"')
    assert read_stairs(path, model, tmp_path / "run1.trc").recording.name == "run1_stairs.csv"


STUDY = """
[study]
name = "ladder"
[[subject]]
name = "m1"
model = "animal.osim"
trials = [{{markers = "walk.trc", {trial}}}]
steps = ["ik", "id", "tension"]
"""


def studied(folder, measures, trial):
    """Results of a study of the animal, whose markers are made of its motion."""
    model, motion, _, _ = recording(folder, measures)
    write(folder, measures)
    places = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]])
    own = [Marker(f"T{k}", "trunk", place) for k, place in enumerate(places)]
    own += [Marker("paw", "paw", np.zeros(3))]
    values = np.concatenate(
        [motion.values[:, None, :3] + places, motion.values[:, None, :3]], axis=1
    )
    values[:, -1, 1] += motion.values[:, 6]
    write_osim(model.with_markers(tuple(own)), folder / "animal.osim")
    slow = slice(None, None, 10)
    write_trc(
        Markers(motion.time[slow], tuple(one.name for one in own), values[slow]),
        folder / "walk.trc",
    )
    (folder / "contacts.toml").write_text('stairs = "stairs.toml"\n')
    (folder / "study.toml").write_text(STUDY.format(trial=trial))
    (outcome,) = run_study(read_plan(folder / "study.toml"), folder / "out")
    assert outcome.error == ""
    return read_result(folder / "out" / "m1" / "walk" / "walk.nc")


def test_a_study_takes_stairs_as_loads(tmp_path):
    found = studied(tmp_path, ("fx", "fy", "fz"), 'loads = "stairs.toml"')
    wrenches = get_wrenches(found)
    assert set(wrenches.names) == {"low_paw", "high_paw"}
    torque = found.values["generalized_force"][:, found.names["coordinate"].index("y")]
    quiet = (found.time < 0.3) | (found.time > 0.7)
    # Standing on the step: the trunk needs nothing but the cell's force.
    assert np.abs(torque[quiet]).max() < 0.02 * WEIGHT


def test_a_study_shares_what_one_axis_measures(tmp_path):
    found = studied(tmp_path, ("fz",), 'contacts = "contacts.toml"')
    forces = get_contact_forces(found)
    quiet = (found.time < 0.3) | (found.time > 0.7)
    np.testing.assert_allclose(forces.contact_force[quiet, 0, 1], WEIGHT, rtol=0.02)
