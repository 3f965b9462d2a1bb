import base64
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.mesh import find_mesh, read_mesh, read_surfaces
from myomorph.core.model.errors import BadFile
from myomorph.core.model.functions import constant
from myomorph.core.model.model import Axis, Body, Joint, Mesh, Model
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface

# A square pyramid: four triangles and a base of four corners.
VERTICES = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1], [0.5, 1, 0.5]], dtype=np.float64)
POLYGONS = [[0, 1, 2, 3], [0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]]
CORNERS = np.array([i for one in POLYGONS for i in one], dtype=np.int64)
ENDS = np.cumsum([len(one) for one in POLYGONS])


def volume(surface: Surface) -> float:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6


def _binary(values: np.ndarray, compressed: bool) -> tuple[bytes, bytes]:
    """Header and body of an array as VTK writes them."""
    raw = values.tobytes()
    if not compressed:
        return struct.pack("<I", len(raw)), raw
    size = 32
    blocks = [raw[i : i + size] for i in range(0, len(raw), size)]
    packed = [zlib.compress(one) for one in blocks]
    last = len(blocks[-1]) if len(blocks[-1]) < size else 0
    return struct.pack(
        f"<{3 + len(packed)}I", len(blocks), size, last, *map(len, packed)
    ), b"".join(packed)


def vtp(form: str, compressed: bool = False, encoding: str = "base64") -> bytes:
    """Return the pyramid as a VTP file in one of its forms."""
    appended = b""
    told = []
    for name, kind, values in (
        ("Points", "Float32", VERTICES.astype("<f4")),
        ("connectivity", "Int64", CORNERS.astype("<i8")),
        ("offsets", "Int32", ENDS.astype("<i4")),
    ):
        three = ' NumberOfComponents="3"' if name == "Points" else ""
        start = f'<DataArray type="{kind}" Name="{name}"{three} format="{form}"'
        if form == "ascii":
            numbers = " ".join(str(one) for one in values.ravel())
            told.append(f"{start}>{numbers}</DataArray>")
            continue
        header, body = _binary(values, compressed)
        data = header + body
        if encoding == "base64":
            # Compressed arrays encode their header by itself, others together with the data.
            data = (
                base64.b64encode(header) + base64.b64encode(body)
                if compressed
                else base64.b64encode(data)
            )
        if form == "binary":
            told.append(f"{start}>{data.decode()}</DataArray>")
        else:
            told.append(f'{start} offset="{len(appended)}"/>')
            appended += data
    points, connectivity, offsets = told
    compressor = ' compressor="vtkZLibDataCompressor"' if compressed else ""
    head = (
        '<?xml version="1.0"?><VTKFile type="PolyData" version="0.1"'
        f' byte_order="LittleEndian"{compressor}><PolyData>'
        '<Piece NumberOfPoints="5"'
        f' NumberOfPolys="5"><Points>{points}</Points><Polys>{connectivity}{offsets}</Polys>'
        "</Piece></PolyData>"
    )
    tail = b""
    if form == "appended":
        tail = f'<AppendedData encoding="{encoding}">_'.encode() + appended + b"</AppendedData>"
    return head.encode() + tail + b"</VTKFile>"


FORMS = {
    "ascii": vtp("ascii"),
    "binary": vtp("binary"),
    "binary, compressed": vtp("binary", True),
    "appended": vtp("appended"),
    "appended, compressed": vtp("appended", True),
    "appended raw": vtp("appended", encoding="raw"),
    "appended raw, compressed": vtp("appended", True, "raw"),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_vtp_is_the_same_pyramid(form: str, tmp_path: Path) -> None:
    path = tmp_path / "bone.vtp"
    path.write_bytes(FORMS[form])
    found = read_mesh(path)
    assert found.vertices == pytest.approx(VERTICES)
    assert len(found.faces) == 6
    assert volume(found) == pytest.approx(1 / 3)


@pytest.mark.parametrize("ending", ["obj", "stl", "ply"])
def test_other_formats_are_the_same_pyramid(ending: str, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    faces = [[one[0], one[k], one[k + 1]] for one in POLYGONS for k in range(1, len(one) - 1)]
    path = tmp_path / f"bone.{ending.upper()}"
    trimesh.Trimesh(VERTICES, faces, process=False).export(path, file_type=ending)
    found = read_mesh(path)
    assert volume(found) == pytest.approx(1 / 3, rel=1e-6)
    assert len(found.vertices) == 5


def test_an_ascii_stl_and_an_obj_of_polygons(tmp_path: Path) -> None:
    stl = tmp_path / "one.stl"
    stl.write_text(
        "solid a\nfacet normal 0 0 1\nouter loop\n"
        "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
    )
    assert read_mesh(stl).faces.shape == (1, 3)
    obj = tmp_path / "two.obj"
    obj.write_text(
        "mtllib ../../secret.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl a\nf 1 2 3 4\n"
    )
    assert read_mesh(obj).faces.shape == (2, 3)


@pytest.mark.parametrize("ending", ["vtp", "obj", "stl", "ply"])
@pytest.mark.parametrize(
    "content", [b"", b"\0" * 200, b"no mesh", np.random.default_rng(0).bytes(3000)]
)
def test_what_is_no_mesh_is_refused(ending: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"bad.{ending}"
    path.write_bytes(content)
    with pytest.raises(BadFile, match=r"bad\."):
        read_mesh(path)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.3, 0.6, 0.85])
def test_files_cut_off_are_refused(form: str, share: float, tmp_path: Path) -> None:
    path = tmp_path / "cut.vtp"
    path.write_bytes(FORMS[form][: int(share * len(FORMS[form]))])
    with pytest.raises(BadFile):
        read_mesh(path)


def test_a_vtp_that_expands_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.vtp"
    path.write_text(
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><VTKFile'
        ' type="PolyData">&c;</VTKFile>'
    )
    with pytest.raises(BadFile, match="entities"):
        read_mesh(path)
    path.write_bytes(
        b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb">]>'
        + FORMS["appended"].replace(b'<?xml version="1.0"?>', b"")
    )
    with pytest.raises(BadFile, match="entities"):
        read_mesh(path)


def test_faces_must_name_vertices_that_exist(tmp_path: Path) -> None:
    path = tmp_path / "bone.vtp"
    path.write_bytes(FORMS["ascii"].replace(b"0 4 1", b"0 40 1"))
    with pytest.raises(BadFile):
        read_mesh(path)


def test_another_kind_of_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"\.msh"):
        read_mesh(tmp_path / "a.msh")
    with pytest.raises(BadFile, match="no such file"):
        read_mesh(tmp_path / "absent.vtp")


def model(*names: str) -> Model:
    meshes = tuple(Mesh(name, Transform.identity(), np.ones(3)) for name in names)
    body = Body(name="bone", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3), meshes=meshes)
    fixed = Axis("rotation", np.array([0.0, 0.0, 1.0]), constant(0.0))
    joint = Joint(
        name="weld",
        kind="WeldJoint",
        parent="ground",
        child="bone",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=(fixed,),
    )
    return Model(name="m", bodies=(body,), joints=(joint,), coordinates=(), gravity=np.zeros(3))


OUTSIDE = [
    "../bone.vtp",
    "a/../../bone.vtp",
    "/etc/bone.vtp",
    "C:\\bones\\bone.vtp",
    "C:bone.vtp",
    "\\\\host\\share\\bone.vtp",
    "..\\bone.vtp",
    "a\\..\\..\\bone.vtp",
    "bone\0.vtp",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_names_that_lead_outside_are_never_opened(name: str, tmp_path: Path) -> None:
    (tmp_path / "bone.vtp").write_bytes(FORMS["ascii"])
    folder = tmp_path / "Geometry"
    (folder / "a").mkdir(parents=True)
    assert find_mesh(name, [folder]) is None
    found, warnings = read_surfaces(model(name, "bone.vtp"), [folder])
    assert found == {}
    assert any("not opened" in one for one in warnings)
    assert any("1 of 2 mesh files" in one for one in warnings)


def test_a_link_that_leads_outside_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "bone.vtp").write_bytes(FORMS["ascii"])
    folder = tmp_path / "Geometry"
    folder.mkdir()
    try:
        (folder / "bone.vtp").symlink_to(tmp_path / "bone.vtp")
    except OSError:
        pytest.skip("this system makes no links")
    assert find_mesh("bone.vtp", [folder]) is None
    assert find_mesh("BONE.vtp", [folder]) is None


def test_names_may_climb_only_inside_a_root(tmp_path: Path) -> None:
    (tmp_path / "outside.vtp").write_bytes(FORMS["ascii"])
    root = tmp_path / "models"
    for folder in ("leg", "meshes"):
        (root / folder).mkdir(parents=True)
    (root / "meshes" / "bone.vtp").write_bytes(FORMS["ascii"])
    assert find_mesh("../meshes/bone.vtp", [root / "leg"]) is None
    assert find_mesh("../meshes/bone.vtp", [root / "leg"], root) == root / "meshes" / "bone.vtp"
    assert find_mesh("../../outside.vtp", [root / "leg"], root) is None


def test_the_case_of_a_name_does_not_matter(tmp_path: Path) -> None:
    (tmp_path / "Femur_R.VTP").write_bytes(FORMS["ascii"])
    found = find_mesh("femur_r.vtp", [tmp_path / "absent", tmp_path])
    assert found is not None
    assert found.is_file()


def test_one_bad_mesh_does_not_spoil_the_others(tmp_path: Path) -> None:
    (tmp_path / "good.vtp").write_bytes(FORMS["ascii"])
    (tmp_path / "bad.vtp").write_bytes(b"no mesh")
    one = model("good.vtp", "bad.vtp")
    ball = Mesh(file="", pose=Transform.identity(), scale=np.ones(3), shape="sphere")
    one = replace(one, bodies=(replace(one.bodies[0], meshes=(*one.bodies[0].meshes, ball)),))
    found, warnings = read_surfaces(one, [tmp_path])
    assert list(found) == ["good.vtp"]
    assert len(warnings) == 1
    assert "bad.vtp" in warnings[0]


@pytest.mark.parametrize(
    "name", ["r_femur.vtp", "l_tibia_SOMEINVERTEDFACES.vtp", "sacrum.vtp", "hat_skull.vtp"]
)
def test_real_bones(name: str, data: Callable[[str], Path]) -> None:
    path = data(f"bones-opensim-rajagopal/Geometry/{name}")
    found = read_mesh(path)
    assert 0.03 < np.ptp(found.vertices, axis=0).max() < 0.6
    text = path.read_text()
    corners = re.search(r'Name="connectivity"[^>]*>([^<]*)<', text)
    polygons = re.search(r'NumberOfPolys="(\d+)"', text)
    assert corners is not None
    assert polygons is not None
    # A polygon of n corners makes n - 2 triangles.
    assert len(found.faces) == len(corners[1].split()) - 2 * int(polygons[1])
