"""A specimen's CT from files: STL and PLY in millimeters, picked points, a recording.

Also bones of a shoulder model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity
from myomorph.swings.viscosity.study.calibration import ScanFiles, model_from_scans, read_picks
from scans import ScanQuality, cluster, made_scan

MODEL = "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim"
OFFSETS = np.array([[0.0, 0.0, 0.0], [0.03, 0.005, 0.0], [0.01, 0.025, 0.0]])
PLACES = {"humerus": np.array([0.02, -0.15, 0.05]), "scapula": np.array([-0.05, -0.03, -0.04])}
NAMES = {"humerus": ("hum1", "hum2", "hum3"), "scapula": ("sca1", "sca2", "sca3")}


def written(path: Path, surface: Surface) -> Path:
    trimesh.Trimesh(1000.0 * surface.vertices, surface.faces, process=False).export(path)
    return path


@pytest.fixture(scope="module")
def specimen(data, tmp_path_factory):
    """Make the model, files of a CT of its bones, and the true positions of its markers.

    The bones are 2 % smaller, with 0.3 mm of noise.
    """
    from myomorph.core.io.mesh import read_mesh
    from myomorph.core.surfaces.clusters import bone_surface

    folder = tmp_path_factory.mktemp("ct")
    model = read_osim(data(MODEL))
    scans = []
    truth = {}
    for seed, (bone, names) in enumerate(NAMES.items(), start=3):
        body = model.body(bone)
        meshes = {
            mesh.file: read_mesh(data(f"{Path(MODEL).parent}/Geometry/{mesh.file}"))
            for mesh in body.meshes
        }
        surface = bone_surface(body, meshes)
        scan, way = made_scan(surface, seed=seed, quality=ScanQuality(refine=1))
        back = way.inverse()
        # The cluster keeps its size; only its middle sits where the model's bone has it.
        turn = Similarity(back.rotation @ rotation_from_euler_xyz((0.1, 0.2, 0.3)), np.zeros(3))
        centers = turn.apply(OFFSETS - OFFSETS.mean(axis=0)) + back.apply(PLACES[bone])
        truth |= {
            name: way.rigid.apply(center) for name, center in zip(names, centers, strict=True)
        }
        truth |= {f"ct {name}": center for name, center in zip(names, centers, strict=True)}
        picked = folder / f"{bone}.csv"
        chosen = surface.vertices[np.linspace(0, len(surface.vertices) - 1, 5).astype(int)]
        lines = ["name,x,y,z,bone_x,bone_y,bone_z"]
        for number, (there, here) in enumerate(zip(1000 * back.apply(chosen), chosen, strict=True)):
            lines.append(
                ",".join([f"p{number}", *(f"{x:.4f}" for x in there), *(f"{x:.6f}" for x in here)])
            )
        picked.write_text("\n".join(lines))
        scans.append(
            ScanFiles(
                bone=bone,
                surface=written(folder / f"{bone}.stl", scan),
                cluster=written(
                    folder / f"{bone}_cluster.ply", cluster(centers, seed=seed, noise=1e-4)
                ),
                markers=names,
                picked=picked if bone == "humerus" else None,
            )
        )
    return model, scans, truth


def recorded(truth) -> Markers:
    names = tuple(name for name in truth if not name.startswith("ct "))
    random = np.random.default_rng(0)
    places = np.array([truth[f"ct {name}"] for name in names])
    values = places + 3e-4 * random.normal(size=(200, len(names), 3))
    values[50:60, 0] = np.nan
    return Markers(0.005 * np.arange(200), names, values)


def test_markers_of_the_scan_come_onto_the_model(specimen):
    model, scans, truth = specimen
    found = model_from_scans(model, scans, recorded(truth))
    assert not found.notes
    for bone, names in NAMES.items():
        for name in names:
            marker = found.model.marker(name)
            assert marker.body == bone
            np.testing.assert_allclose(marker.location, truth[name], atol=7e-4)
    assert [bone.scale for bone in found.bones] == pytest.approx([1.02, 1.02], abs=4e-3)
    assert all(one.misfit < 3e-4 for one in found.clusters)
    assert found.model.body("humerus").mass < model.body("humerus").mass


def test_without_a_recording_picked_points_must_tell_the_markers_apart(specimen):
    model, scans, _ = specimen
    with pytest.raises(BadData, match="nothing distinguishes the markers hum1, hum2, hum3"):
        model_from_scans(model, scans)


def test_wrong_tables_are_named(specimen, tmp_path):
    model, scans, truth = specimen
    table = ScanFiles(
        bone="humerus", surface="a.stl", cluster="b.stl", markers=["hum1", "hum2", "hum3"]
    )
    assert table.within(tmp_path).surface == tmp_path / "a.stl"
    with pytest.raises(BadData, match="2 markers, but a cluster needs three"):
        table.model_copy(update={"markers": ["hum1", "hum2"]}).within(tmp_path)
    with pytest.raises(BadData, match="unit 'inch'"):
        table.model_copy(update={"unit": "inch"}).within(tmp_path)
    with pytest.raises(BadFile, match=r"a\.stl: no such file"):
        model_from_scans(model, [table.within(tmp_path)])
    wrong = [scans[0].model_copy(update={"markers": ("hum1", "hum2", "x9"), "picked": None})]
    with pytest.raises(UnknownName, match="unknown marker 'x9'"):
        model_from_scans(model, wrong, recorded(truth))


def test_tables_of_points_are_read_and_bad_lines_named(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name,x,y,z\nhead,1,2,3\nhum1, 4,5,6 ,,,\nlateral,1,2,3,4,5,6\n")
    found = read_picks(path)
    assert list(found) == ["head", "hum1", "lateral"]
    assert len(found["lateral"]) == 6
    path.write_text("name,x,y,z\nhead,1,2\n")
    with pytest.raises(BadFile, match=r"line 2 is not 'name, x, y, z'"):
        read_picks(path)
    path.write_text("name,x,y,z\n")
    with pytest.raises(BadFile, match="holds no point"):
        read_picks(path)
