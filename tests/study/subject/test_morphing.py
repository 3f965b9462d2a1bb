"""A morph from files: a thigh and a shank as made bones.

From folder to model, bones, tables and report.
"""

import csv
import re

import numpy as np
import pytest
import trimesh

from myomorph.bones.study.morph_files import MorphFiles, bone_files, read_bones
from myomorph.bones.study.morphing import MorphSettings, morph_files, summary, write_morphed
from myomorph.core.io.formats import read_model
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Marker, Mesh, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.lab.cli.program import main
from myomorph.lab.study.subject.subjects import tables_folder

GROWTH = np.array([1.1, 0.9, 1.2])
SLIDE = 0.012
"""A hundredth of both bones' lengths: a smooth shaft tells little along itself [m]."""
QUICK = {"match_points": 300, "feature_count": 150}


def bone(seed):
    """Make a bone that fits another only one way [m].

    It is a shaft with three knobs of different sizes.
    """
    rng = np.random.default_rng(seed)
    made = trimesh.creation.icosphere(subdivisions=4)
    direction = made.vertices / np.linalg.norm(made.vertices, axis=1)[:, None]
    radius = np.ones(len(direction))
    for size, axis in zip(
        (0.7, 0.5, 0.3), ([0.3, 1, 0.2], [-0.4, -1, 0.5], [1, -0.7, -0.6]), strict=True
    ):
        toward = np.array(axis) / np.linalg.norm(axis)
        radius += size * np.exp(8.0 * (direction @ toward - 1.0)) * (1.0 + 0.1 * rng.random())
    return trimesh.Trimesh(
        direction * radius[:, None] * [0.02, 0.2, 0.02] - [0, 0.2, 0], made.faces
    )


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """Folder with `leg.osim`, its bones, and `bones/` of one grown along its axes."""
    folder = tmp_path_factory.mktemp("leg")
    (folder / "Geometry").mkdir()
    (folder / "bones").mkdir()
    pairs = ["body,name,source_x,source_y,source_z,target_x,target_y,target_z"]
    bodies = []
    joints = []
    coordinates = []
    parent = "ground"
    for k, name in enumerate(("femur_r", "tibia_r")):
        shape = bone(k)
        shape.export(folder / "Geometry" / f"{name}.obj")
        trimesh.Trimesh(shape.vertices * GROWTH, shape.faces).export(
            folder / "bones" / f"{name}.stl"
        )
        order = np.argsort(shape.vertices[:, 1])
        for count, place in enumerate(shape.vertices[order[:: len(order) // 9]]):
            pairs.append(",".join(map(str, (name, f"p{count}", *place, *(place * GROWTH)))))
        mesh = Mesh(f"{name}.obj", Transform.identity(), np.ones(3))
        bodies.append(
            Body(
                name=name,
                mass=2.0,
                mass_center=np.array([0, -0.2, 0]),
                inertia=np.diag([0.02, 0.001, 0.02]),
                meshes=(mesh,),
            )
        )
        place = Transform(np.eye(3), np.array([0.0, -0.4 * k, 0.0]))
        turn = Axis(
            kind="rotation",
            vector=[0.0, 0.0, 1.0],
            function=linear(1.0, 0.0),
            coordinates=(f"q{k}",),
        )
        joints.append(
            Joint(
                name=f"j{k}",
                kind="PinJoint",
                parent=parent,
                child=name,
                parent_frame=place,
                child_frame=Transform.identity(),
                axes=(turn,),
                coordinates=(f"q{k}",),
            )
        )
        coordinates.append(Coordinate(f"q{k}", range=(-0.5, 0.5)))
        parent = name
    points = (
        PathPoint("P1", "femur_r", [0.022, -0.1, 0.0]),
        PathPoint("P2", "femur_r", [0.03, -0.35, 0.0]),
        PathPoint("P3", "tibia_r", [0.024, -0.1, 0.004]),
    )
    muscle = Muscle(
        name="vas",
        kind="Thelen2003Muscle",
        path=Path(points),
        max_isometric_force=1000.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.25,
    )
    marker = Marker("KNEE", "femur_r", [0.0, -0.4, 0.05])
    leg = Model(
        name="leg",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=[0, -9.81, 0],
        markers=(marker,),
        muscles=(muscle,),
    )
    write_osim(leg, folder / "leg.osim")
    (folder / "pairs.csv").write_text("\n".join(pairs) + "\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def morphed(leg):
    files = MorphFiles(leg / "leg.osim", leg / "bones", leg / "pairs.csv")
    return morph_files(files, MorphSettings.of(QUICK))


def test_bones_that_are_stretched_take_their_muscles_along(morphed):
    source = morphed.morph.source
    target = morphed.morph.model
    for before, after in zip(
        source.muscles[0].path.points, target.muscles[0].path.points, strict=True
    ):
        assert np.linalg.norm(after.location - before.location * GROWTH) < SLIDE
    marker = target.marker("KNEE").location
    assert np.linalg.norm(marker - source.marker("KNEE").location * GROWTH) < SLIDE
    knee = target.joints[1].parent_frame.translation
    assert np.linalg.norm(knee - source.joints[1].parent_frame.translation * GROWTH) < SLIDE


def test_the_summary_tells_each_bone_in_a_line(morphed):
    lines = list(summary(morphed))
    bone = morphed.morph.bones["femur_r"]
    told = next(line for line in lines if "femur_r" in line)
    assert f"size {bone.whole.scale:.3f}" in told
    assert f"{1e3 * bone.measures['residual [m]']:.3g} mm apart" in told
    assert any("1 muscles, 3 points" in line for line in lines)


def test_model_bones_tables_and_report_are_written_together(morphed, leg, tmp_path):
    out = tmp_path / "own.osim"
    folder = tables_folder(out, "morph")
    write_morphed(morphed, out, folder)
    again = read_model(out)
    drawn = read_mesh(tmp_path / again.bodies[0].meshes[0].file)
    np.testing.assert_allclose(
        np.ptp(drawn.vertices, axis=0),
        np.ptp(read_mesh(leg / "bones" / "femur_r.stl").vertices, axis=0),
        atol=1e-6,
    )
    with (folder / "points.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["point"] for row in rows] == ["P1", "P2", "P3"]
    place = [float(rows[2][f"target {axis} [m]"]) for axis in "xyz"]
    np.testing.assert_allclose(place, again.muscles[0].path.points[2].location, rtol=1e-5)
    assert "vas" in (folder / "report.html").read_text(encoding="utf-8")
    write_morphed(morphed, out, folder)


def test_masses_come_as_told(leg, tmp_path):
    (tmp_path / "tibia_r.stl").write_bytes((leg / "bones" / "tibia_r.stl").read_bytes())
    files = MorphFiles(leg / "leg.osim", tmp_path, mass=5.0)
    assert morph_files(files, MorphSettings.of(QUICK)).morph.model.mass == pytest.approx(5.0)


def test_a_bone_that_no_body_is_named_after_is_told(leg, tmp_path):
    notes = []
    for name in ("femur_r.stl", "skull.stl"):
        (tmp_path / name).write_bytes((leg / "bones" / "femur_r.stl").read_bytes())
    assert list(read_bones(tmp_path, ("femur_r", "tibia_r"), "m", notes)) == ["femur_r"]
    assert "skull.stl" in notes[0]


def test_two_files_for_one_bone_are_refused(leg, tmp_path):
    for ending in ("stl", "obj"):
        (tmp_path / f"femur_r.{ending}").write_bytes(b"")
    with pytest.raises(BadFile, match=r"femur_r\.obj and femur_r\.stl"):
        bone_files(tmp_path)


def test_names_that_differ_in_case_are_one_bone(leg, tmp_path):
    for name in ("femur_r.stl", "FEMUR_R.obj"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(BadFile, match="keep one file a bone"):
        bone_files(tmp_path)


def test_what_a_morph_is_made_from_is_not_written_over(leg, tmp_path, capsys):
    source = tmp_path / "leg.osim"
    source.write_bytes((leg / "leg.osim").read_bytes())
    bones = tmp_path / "subject_morph"
    bones.mkdir()
    (bones / "femur_r.stl").write_bytes((leg / "bones" / "femur_r.stl").read_bytes())
    for out in (source, tmp_path / "subject.osim"):
        before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        told = ("--bones", str(bones), "--geometry", str(leg / "Geometry"), "--out", str(out))
        assert main(["morph", "--source", str(source), *told]) == 2
        assert "would be written over" in capsys.readouterr().err
        assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_mass_that_is_none_is_refused_before_bones_are_matched(leg):
    for mass in (0.0, -5.0, np.nan):
        with pytest.raises(BadData, match="mass of"):
            morph_files(
                MorphFiles(leg / "leg.osim", leg / "bones", mass=mass), MorphSettings.of(QUICK)
            )


def test_a_folder_without_bones_of_the_model_is_refused(leg, tmp_path):
    (tmp_path / "skull.stl").write_bytes((leg / "bones" / "femur_r.stl").read_bytes())
    with pytest.raises(BadFile, match="femur_r"):
        morph_files(MorphFiles(leg / "leg.osim", tmp_path), MorphSettings.of(QUICK))


def test_bones_in_millimetres_are_named(leg, tmp_path):
    big = trimesh.load(leg / "bones" / "femur_r.stl")
    big.apply_scale(1000.0)
    big.export(tmp_path / "femur_r.stl")
    with pytest.raises(BadData, match="as if in millimeters"):
        morph_files(MorphFiles(leg / "leg.osim", tmp_path), MorphSettings.of(QUICK))
    told = morph_files(MorphFiles(leg / "leg.osim", tmp_path, unit="mm"), MorphSettings.of(QUICK))
    assert told.morph.bones["femur_r"].whole.scale == pytest.approx(
        np.cbrt(np.prod(GROWTH)), rel=0.2
    )


def test_landmarks_of_a_body_that_is_not_there_are_named(leg, tmp_path):
    table = tmp_path / "pairs.csv"
    table.write_text(
        "body,name,source_x,source_y,source_z,target_x,target_y,target_z\nfemur_l,head,0,0,0,0,0,0\n",
        encoding="utf-8",
    )
    with pytest.raises(BadData, match="femur_l"):
        morph_files(MorphFiles(leg / "leg.osim", leg / "bones", table), MorphSettings.of(QUICK))


@pytest.mark.parametrize(
    ("told", "answer"),
    [
        ((), "--bones"),
        (("--bones", "nowhere"), "nowhere"),
        (("--bones", "nowhere", "--target", "mouse.xml"), "no --bones"),
        (("--target", "mouse.xml", "--species", "human-dog"), "human-mouse"),
        (("--target", "mouse.xml", "--landmarks", "mouse.xml"), "--landmarks goes with --bones"),
        (("--bones", "nowhere", "--protocol", "lab"), "--protocol goes with --target"),
        (("--bones", "nowhere", "--beside"), "--beside goes with --target"),
        (("--bones", "nowhere", "--link", "skin=femur_r"), "LINK=BONE,BONE"),
    ],
)
def test_what_the_command_cannot_do_ends_in_one_line(leg, tmp_path, capsys, told, answer):
    (tmp_path / "mouse.xml").write_text("<mujoco/>", encoding="utf-8")
    told = [str(tmp_path / one) if one == "mouse.xml" else one for one in told]
    status = main(
        ["morph", "--source", str(leg / "leg.osim"), "--out", str(tmp_path / "o.osim"), *told]
    )
    error = capsys.readouterr().err
    assert status == 2
    assert answer in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "o.osim").exists()


def test_a_study_begins_with_the_subject_s_bones(leg, tmp_path, capsys):
    rows = "\n".join(f"{k + 1}\t{0.01 * k}\t0\t{-400 + k}\t50" for k in range(20))
    header = (
        "PathFileType\t4\t(X/Y/Z)\tw.trc\n"
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
        "OrigDataStartFrame\tOrigNumFrames\n100\t100\t20\t1\tmm\t100\t1\t20\n"
        "Frame#\tTime\tKNEE\n\t\tX1\tY1\tZ1\n\n"
    )
    (tmp_path / "w.trc").write_text(header + rows + "\n", encoding="utf-8")
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "tibia_r.stl").write_bytes((leg / "bones" / "tibia_r.stl").read_bytes())
    study = tmp_path / "study.toml"
    quick = "\n".join(f"{name} = {value}" for name, value in QUICK.items())
    study.write_text(
        '[study]\nname = "own"\n[[subject]]\nname = "s1"\nmodel ='
        f' "{(leg / "leg.osim").as_posix()}"\ntrials = ["w.trc"]\nsteps = ["morph", "ik"]\nbones ='
        f' {{ folder = "scan" }}\n[options.morph]\n{quick}\n',
        encoding="utf-8",
    )
    assert main(["run", str(study), "--out", str(tmp_path / "out")]) == 0
    made = next((tmp_path / "out").rglob("morphed.osim"))
    assert (made.parent / "morph" / "tibia_r.obj").is_file()
    first = made.stat().st_mtime_ns
    capsys.readouterr()
    assert main(["run", str(study), "--out", str(tmp_path / "out"), "--resume"]) == 0
    assert made.stat().st_mtime_ns == first
    assert re.search(r"unchanged", capsys.readouterr().out)


def test_a_study_says_what_its_bones_lack(leg, tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(
        '[study]\nname = "own"\n[[subject]]\nname = "s1"\nmodel ='
        f' "{(leg / "leg.osim").as_posix()}"\ntrials = ["w.trc"]\nsteps = ["morph", "ik"]\n',
        encoding="utf-8",
    )
    assert main(["run", str(study), "--out", str(tmp_path / "out")]) == 2
    assert "folder of the subject's bones" in capsys.readouterr().err


def test_bones_of_odd_names_have_files_of_their_own():
    from myomorph.bones.study.morphing import _bone_files

    files = _bone_files(("a b", "a_b", "A_B", "../up", "..", "femur_r"))
    assert files["femur_r"] == "femur_r.obj"
    assert len({file.lower() for file in files.values()}) == len(files)
    assert not any("/" in file or file.startswith(".") for file in files.values())
