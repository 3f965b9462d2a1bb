"""The smallest example: files of an arm with two joints and two muscles.

The arm reaches with a weight. The files are synthetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import marker_positions

BODY = """<Body name="{name}"><mass>{mass}</mass><mass_center>0 -0.15 0</mass_center>
<inertia>0.02 0.002 0.02 0 0 0</inertia></Body>"""
PIN = """<PinJoint name="{name}"><socket_parent_frame>{name}_parent</socket_parent_frame>
<socket_child_frame>{name}_child</socket_child_frame>
<coordinates><Coordinate name="{coordinate}"><default_value>0.2</default_value><range>-3 3</range>\
</Coordinate>
</coordinates>
<frames>
<PhysicalOffsetFrame name="{name}_parent"><socket_parent>{parent}</socket_parent>\
<translation>{at}</translation>
</PhysicalOffsetFrame>
<PhysicalOffsetFrame name="{name}_child"><socket_parent>/bodyset/{child}</socket_parent>\
</PhysicalOffsetFrame>
</frames></PinJoint>"""
MARKER = """<Marker name="{name}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>
<location>{at}</location></Marker>"""
POINT = """<PathPoint name="{name}"><socket_parent_frame>{body}</socket_parent_frame>
<location>{at}</location></PathPoint>"""
MUSCLE = """<Millard2012EquilibriumMuscle name="{name}">\
<max_isometric_force>800</max_isometric_force>
<optimal_fiber_length>0.12</optimal_fiber_length><tendon_slack_length>{slack}</tendon_slack_length>
<GeometryPath name="path"><PathPointSet><objects>{points}</objects></PathPointSet></GeometryPath>
</Millard2012EquilibriumMuscle>"""
DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><Model name="arm"><gravity>0 -9.80665 0</gravity>
<BodySet><objects>{bodies}</objects></BodySet>
<JointSet><objects>{joints}</objects></JointSet>
<ForceSet><objects>{muscles}</objects></ForceSet>
<MarkerSet><objects>{markers}</objects></MarkerSet>
</Model></OpenSimDocument>
"""
MARKERS = {
    "UA1": ("upper", "0.05 -0.05 0"),
    "UA2": ("upper", "-0.05 -0.2 0.03"),
    "FA1": ("fore", "0.04 -0.1 0"),
    "FA2": ("fore", "-0.03 -0.25 0.02"),
}
LOADS = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><ExternalLoads name="loads"><objects><ExternalForce name="hand">
<applied_to_body>{body}</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>
<point_expressed_in_body>ground</point_expressed_in_body><force_identifier>hand_v</force_identifier>
<point_identifier>hand_p</point_identifier></ExternalForce></objects>
<datafile>{table}</datafile></ExternalLoads></OpenSimDocument>
"""


def osim_text(mass: float = 2.0) -> str:
    """Write the arm as an OpenSim document.

    Its shoulder is fixed at 1.4 m. It has two pin joints and two muscles.
    """
    muscles = [
        ("flexor", "0.25", (("/ground", "0.03 1.35 0"), ("/bodyset/fore", "0.04 -0.04 0"))),
        ("extensor", "0.2", (("/ground", "-0.03 1.35 0"), ("/bodyset/fore", "-0.02 0.02 0"))),
    ]
    return DOCUMENT.format(
        bodies="".join(BODY.format(name=name, mass=mass) for name in ("upper", "fore")),
        joints=PIN.format(
            name="shoulder",
            coordinate="shoulder_flexion",
            parent="/ground",
            child="upper",
            at="0 1.4 0",
        )
        + PIN.format(
            name="elbow",
            coordinate="elbow_flexion",
            parent="/bodyset/upper",
            child="fore",
            at="0 -0.3 0",
        ),
        muscles="".join(
            MUSCLE.format(
                name=name,
                slack=slack,
                points="".join(
                    POINT.format(name=f"p{i}", body=body, at=at)
                    for i, (body, at) in enumerate(points)
                ),
            )
            for name, slack, points in muscles
        ),
        markers="".join(
            MARKER.format(name=name, body=body, at=at) for name, (body, at) in MARKERS.items()
        ),
    )


def table_text(columns: dict[str, np.ndarray], degrees: str = "no") -> str:
    """Write columns as a MOT file, the first of them the time.

    Parameters
    ----------
    columns : (rows,) each, by name, in the file's units
    degrees : "yes" where angles are in degrees, else "no"

    Returns
    -------
    The text of the file
    """
    rows = np.column_stack(list(columns.values()))
    head = (
        f"table\nversion=1\nnRows={len(rows)}\nnColumns={len(columns)}\n"
        f"inDegrees={degrees}\nendheader\n"
    )
    return (
        head
        + "\t".join(columns)
        + "\n"
        + "\n".join("\t".join(f"{x:.8g}" for x in row) for row in rows)
        + "\n"
    )


@dataclass(frozen=True)
class ExampleFiles:
    """Files of the example by role.

    Attributes
    ----------
    folder : that holds them all
    model : `arm.osim`, two pin joints, two muscles, four markers
    markers : `reach.trc`, 0.6 s at 100 Hz
    motion : `reach.mot`, the coordinates that the markers were made of [rad]
    loads, forces : `reach_grf.xml` and its table, 10 N downwards on the forearm
    emg : `reach_emg.sto`, an envelope of the flexor
    out : for results, not made yet
    """

    folder: Path
    model: Path
    markers: Path
    motion: Path
    loads: Path
    forces: Path
    emg: Path
    out: Path


def example_files(folder: str | Path) -> ExampleFiles:
    """Write the files of a small synthetic example: what `ik`, `id` and `tension` need.

    Parameters
    ----------
    folder : that exists; files of the same names are replaced

    Returns
    -------
    the paths by role

    Raises
    ------
    OSError
        where the folder does not exist, or a file cannot be written in it

    Examples
    --------
    >>> import myomorph as mm
    >>> files = mm.example_files(".")
    >>> files.model.name, files.markers.name
    ('arm.osim', 'reach.trc')
    """
    folder = Path(folder)
    files = ExampleFiles(
        folder=folder,
        model=folder / "arm.osim",
        markers=folder / "reach.trc",
        motion=folder / "reach.mot",
        loads=folder / "reach_grf.xml",
        forces=folder / "reach_forces.mot",
        emg=folder / "reach_emg.sto",
        out=folder / "out",
    )
    files.model.write_text(osim_text(), encoding="utf-8")
    time = np.arange(61) / 100.0
    angles = np.column_stack([0.3 * np.sin(6 * time), 0.8 + 0.5 * np.sin(8 * time)])
    names = ("shoulder_flexion", "elbow_flexion")
    files.motion.write_text(
        table_text({"time": time, **dict(zip(names, angles.T, strict=True))}), encoding="utf-8"
    )
    model = read_osim(files.model)
    write_trc(marker_positions(model, Motion(time, names, angles)), files.markers)
    force = {
        f"hand_v{axis}": np.full_like(time, value)
        for axis, value in zip("xyz", (0, -10, 0), strict=True)
    }
    point = {
        f"hand_p{axis}": np.full_like(time, value)
        for axis, value in zip("xyz", (0, 0.8, 0), strict=True)
    }
    files.forces.write_text(table_text({"time": time, **force, **point}), encoding="utf-8")
    files.loads.write_text(LOADS.format(body="fore", table=files.forces.name), encoding="utf-8")
    files.emg.write_text(
        table_text({"time": time, "flexor": 0.5 + 0.4 * np.sin(8 * time)}), encoding="utf-8"
    )
    return files
