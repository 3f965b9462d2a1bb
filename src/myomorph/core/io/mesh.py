"""Meshes of bones and skins: VTP, OBJ, STL and PLY files, looked up only inside given folders."""

from __future__ import annotations

import base64
import io
import logging
import os
import re
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from lxml import etree

from myomorph.core.io.parsing.text import check_size
from myomorph.core.io.parsing.xml import ENTITIES, read_xml
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile, MyomorphError, quoted
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface

LARGEST = 256 * 1024 * 1024
ENDINGS = (".vtp", ".obj", ".stl", ".ply")
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
"""A triangle of a binary STL file, of which it holds as many as its bytes 80 to 83 say."""
_TYPES = {"Float32": "f4", "Float64": "f8"} | {
    f"{sign}Int{8 * size}": f"{letter}{size}"
    for sign, letter in (("", "i"), ("U", "u"))
    for size in (1, 2, 4, 8)
}


def read_surfaces(
    model: Model, folders: Sequence[str | Path], root: str | Path | None = None
) -> tuple[dict[str, Surface], tuple[str, ...]]:
    """Read the meshes that a model draws its bodies with.

    What cannot be drawn is left out and named in a warning: a picture is not worth a stop.

    Parameters
    ----------
    model : its bodies' meshes are read
    folders : where to look, in order
    root : names may climb out of a folder (`../meshes/femur.stl`, as MuJoCo's models do) as long as
        they stay inside this one; None forbids climbing

    Returns
    -------
    surfaces in the files' units by `Mesh.file`, and warnings, one line each
    """
    wanted = [
        mesh.file
        for body in model.bodies
        for mesh in body.meshes
        if mesh.shape == "mesh" and mesh.file
    ]
    surfaces: dict[str, Surface] = {}
    refused = []
    missing = []
    warnings = []
    for name in dict.fromkeys(wanted):
        if not _allowed(name, root is not None):
            refused.append(name)
            continue
        path = find_mesh(name, folders, root)
        if path is None:
            missing.append(name)
            continue
        try:
            surfaces[name] = read_mesh(path)
        except MyomorphError as error:
            warnings.append(str(error))
    if refused:
        warnings.append(
            f"mesh files outside the model's folder are not opened: {quoted(refused, 4)}"
        )
    if missing:
        where = ", ".join(str(folder) for folder in folders) or "no folder"
        count = len(dict.fromkeys(wanted))
        warnings.append(
            f"{len(missing)} of {count} mesh files are not in {where}: {quoted(missing, 4)}"
        )
    return surfaces, tuple(warnings)


def find_mesh(
    name: str, folders: Iterable[str | Path], root: str | Path | None = None
) -> Path | None:
    """Find a mesh inside one of the folders.

    Models made on Windows often write another case than the file has; the one that exists is taken.

    Parameters
    ----------
    name : of the file as the model has it, with folders or without
    folders : where to look, in order
    root : folder in which a name may climb; None forbids climbing

    Returns
    -------
    path of the file; None where there is none or the name leads outside
    """
    if not _allowed(name, root is not None):
        return None
    relative = PurePosixPath(name.replace("\\", "/"))
    for directory in folders:
        folder = Path(directory).resolve()
        border = Path(root).resolve() if root is not None else folder
        path = (folder / relative).resolve()
        if not path.is_relative_to(border):
            continue
        if path.is_file():
            return path
        if path.parent.is_dir():
            for file in path.parent.iterdir():
                inside = file.resolve().is_relative_to(border)
                if file.name.lower() == path.name.lower() and inside and file.is_file():
                    return file
    return None


def _allowed(name: str, climbing: bool) -> bool:
    """Return whether a mesh's name stays where the model is: relative, no drive, no way up."""
    windows = PureWindowsPath(name)
    posix = PurePosixPath(name.replace("\\", "/"))
    if not name or "\0" in name or windows.drive or windows.root or posix.is_absolute():
        return False
    return climbing or ".." not in posix.parts


def read_mesh(path: str | Path) -> Surface:
    """Read the surface in a VTP, OBJ, STL or PLY file.

    Vertices that lie on each other become one; polygons become triangles; textures and materials
    are not read.

    Their layouts are those that VTK, Wavefront, 3D Systems and Stanford's PLY define; see
    docs/morphing.md.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    vertices (vertices, 3) in the file's units (meters in models) and faces (faces, 3)

    Raises
    ------
    BadFile : the file is absent, too large, cut off, of another kind or without a surface

    Examples
    --------
    >>> import trimesh
    >>> import myomorph as mm
    >>> _ = trimesh.creation.icosphere(subdivisions=1, radius=0.02).export("ball.ply")
    >>> ball = mm.read_mesh("ball.ply")
    >>> ball.vertices.shape, ball.faces.shape
    ((42, 3), (80, 3))
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise BadFile(
            path, f"is not a mesh: its name ends in '{ending}'", f"expected {', '.join(ENDINGS)}"
        )
    check_size(path, LARGEST, "a mesh")
    try:
        surface = _read_vtp(path) if ending == ".vtp" else _read_other(path, ending[1:])
    except BadFile:
        raise
    except Exception as error:
        # A parser fed with damaged bytes fails in every way there is; all of them mean the same to
        # users.
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise BadFile(path, f"is not a readable mesh ({reason})", "is the file cut off?") from None
    if not len(surface.faces):
        raise BadFile(path, "holds no triangles")
    return surface


def _read_other(path: Path, kind: str) -> Surface:
    """Read an OBJ, STL or PLY file; `BadFile` where it holds no triangles."""
    content = path.read_bytes()
    if (
        kind == "stl"
        and len(content) == 84 + STL_FACE.itemsize * int.from_bytes(content[80:84], "little") > 84
    ):
        corners = np.frombuffer(content, STL_FACE, offset=84)["corners"].reshape(-1, 3)
        return merged(corners, np.arange(len(corners)).reshape(-1, 3))
    # Imported here because trimesh takes half a second, which binary STL, as bones mostly are, need
    # not pay.
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.ERROR)
    options = {"skip_materials": True} if kind == "obj" else {}
    loaded = trimesh.load(
        io.BytesIO(content), file_type=kind, process=False, force="mesh", **options
    )
    vertices = np.asarray(getattr(loaded, "vertices", ()), dtype=np.float64)
    faces = np.asarray(getattr(loaded, "faces", ()), dtype=np.int64)
    if vertices.size == 0 or faces.size == 0:
        raise BadFile(path, "holds no triangles")
    return merged(vertices, faces)


def merged(vertices: Array, faces: np.ndarray) -> Surface:
    """Merge equal vertices, so that normals are smooth (STL repeats every corner).

    Parameters
    ----------
    vertices : (vertices, 3)
    faces : (faces, 3) indices of vertices

    Returns
    -------
    the surface with its vertices in rising order of x, y and z
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    # What np.unique gives for rows, five times as fast.
    order = np.lexsort(vertices.T[::-1])
    ordered = vertices[order]
    first = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    owner = np.empty(len(vertices), dtype=np.int64)
    owner[order] = np.cumsum(first) - 1
    return Surface(ordered[first], owner[faces])


def _read_vtp(path: Path) -> Surface:
    """Read VTK's XML PolyData: ASCII, base64 and appended arrays, compressed by zlib or not.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    the surface of all pieces, polygons and strips as triangles

    Raises
    ------
    BadFile : it is not such a file, declares XML entities, or holds no polygons
    """
    content = path.read_bytes()
    marked = re.search(rb"<AppendedData[^>]*>", content)
    appended = b""
    if marked and ENTITIES.search(content[: marked.start()]):
        raise BadFile(path, "declares XML entities, which could expand without end")
    if marked:
        # Raw appended bytes are no XML: they are cut out before it is parsed.
        end = content.rfind(b"</AppendedData>")
        appended = content[marked.end() : end if end > 0 else len(content)].lstrip()[1:]
        document = etree.fromstring(
            content[: marked.end()]
            + b"</AppendedData>"
            + content[end + 15 if end > 0 else len(content) :],
            etree.XMLParser(
                resolve_entities=False,
                no_network=True,
                load_dtd=False,
                huge_tree=False,
                recover=True,
            ),
        )
    else:
        document = read_xml(path).root
    if document is None or document.tag != "VTKFile" or document.get("type") != "PolyData":
        raise BadFile(path, "is not a VTP file", 'expected <VTKFile type="PolyData">')
    reader = _Arrays(document, appended, b'encoding="raw"' in (marked[0] if marked else b""))
    vertices = []
    faces = []
    first = 0
    for piece in document.iter("Piece"):
        points = reader.array(piece.find("Points/DataArray")).reshape(-1, 3)
        for name, triangles in (("Polys", _fans), ("Strips", _strips)):
            group = piece.find(name)
            arrays = (
                {}
                if group is None
                else {element.get("Name"): element for element in group.findall("DataArray")}
            )
            if "connectivity" in arrays and "offsets" in arrays:
                corners = reader.array(arrays["connectivity"]).astype(np.int64)
                ends = reader.array(arrays["offsets"]).astype(np.int64)
                if len(ends):
                    faces.append(triangles(corners, ends) + first)
        vertices.append(points)
        first += len(points)
    if not vertices or not faces:
        raise BadFile(path, "holds no polygons")
    return Surface(np.concatenate(vertices), np.concatenate(faces))


def _fans(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Split polygons into triangles around each one's first corner.

    Parameters
    ----------
    corners : (corners,) indices of vertices, polygon after polygon
    ends : (polygons,) index behind each polygon's last corner

    Returns
    -------
    (triangles, 3)
    """
    starts = np.concatenate([[0], ends[:-1]])
    sides = ends - starts
    triangles = []
    for index in range(1, int(sides.max()) - 1):
        first = starts[sides > index + 1]
        triangles.append(
            np.stack([corners[first], corners[first + index], corners[first + index + 1]], axis=1)
        )
    return np.concatenate(triangles) if triangles else np.zeros((0, 3), np.int64)


def _strips(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Split strips into triangles: every next corner makes one with the two before it.

    Parameters
    ----------
    corners : (corners,) indices of vertices, strip after strip
    ends : (strips,) index behind each strip's last corner

    Returns
    -------
    (triangles, 3), every second one of a strip turned over so that all face one side
    """
    triangles = []
    for start, end in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True):
        strip = corners[start:end]
        three = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
        three[1::2] = three[1::2, ::-1]
        triangles.append(three)
    return np.concatenate(triangles) if triangles else np.zeros((0, 3), np.int64)


class _Arrays:
    """Reader of the `DataArray` elements of one VTP document.

    Parameters
    ----------
    document : outermost element
    appended : bytes behind the mark of the appended data
    raw : whether these are bytes, not base64
    """

    def __init__(self, document: etree._Element, appended: bytes, raw: bool):
        self.order = ">" if document.get("byte_order") == "BigEndian" else "<"
        self.header = self.order + _TYPES[document.get("header_type", "UInt32")]
        self.compressor = document.get("compressor", "")
        self.appended = appended
        self.raw = raw

    def array(self, element: etree._Element | None) -> np.ndarray:
        """Read the numbers of one element, flat.

        Parameters
        ----------
        element : a `DataArray`

        Returns
        -------
        (numbers,) in the element's type

        Raises
        ------
        ValueError : there is no element, it is cut off, or its compressor is unknown
        """
        if element is None:
            raise ValueError("no DataArray")
        kind = _TYPES[element.get("type", "Float32")]
        form = element.get("format", "ascii")
        if form == "ascii":
            return np.array((element.text or "").split(), dtype=kind)
        if form == "appended":
            data = self.appended[int(element.get("offset", "0")) :]
            return self._decoded(data, self.order + kind, self.raw)
        return self._decoded(
            "".join((element.text or "").split()).encode(), self.order + kind, False
        )

    def _decoded(self, data: bytes, kind: str, raw: bool) -> np.ndarray:
        """Decode an array behind its header: a count of bytes, or sizes of compressed blocks.

        Parameters
        ----------
        data : from the array's first byte or character on; more may follow
        kind : data type of the numbers
        raw : whether they are bytes, not base64

        Returns
        -------
        (numbers,)

        Raises
        ------
        ValueError : it is cut off, or its compressor is unknown
        """
        size = np.dtype(self.header).itemsize
        if not self.compressor:
            body = data if raw else base64.b64decode(_only_base64(data))
            count = int(np.frombuffer(body, self.header, 1)[0])
            return np.frombuffer(_exactly(body[size:], count), kind)
        if self.compressor != "vtkZLibDataCompressor":
            raise ValueError(f"compressor {self.compressor}")
        if raw:
            blocks = int(np.frombuffer(data, self.header, 1)[0])
            head = data[: size * (3 + blocks)]
            body = data[size * (3 + blocks) :]
        else:
            blocks = int(np.frombuffer(base64.b64decode(data[: _padded(size)]), self.header, 1)[0])
            cut = _padded(size * (3 + blocks))
            head = base64.b64decode(data[:cut])
            body = base64.b64decode(_only_base64(data[cut:]))
        sizes = np.frombuffer(head, self.header, 3 + blocks)[3:].astype(np.int64)
        ends = np.cumsum(sizes)
        parts = [
            zlib.decompress(_exactly(body[end - size : end], size))
            for end, size in zip(ends, sizes, strict=True)
        ]
        return np.frombuffer(b"".join(parts), kind)


def _padded(size: int) -> int:
    """Return how many characters base64 needs for so many bytes."""
    return 4 * ((size + 2) // 3)


def _only_base64(data: bytes) -> bytes:
    """Cut out the first run of base64 text: appended arrays stand one behind the other."""
    match = re.match(rb"[A-Za-z0-9+/]*={0,2}", data)
    return match[0] if match else b""


def _exactly(data: bytes, count: int) -> bytes:
    """Return the first bytes; `ValueError` where there are fewer than `count`."""
    if len(data) < count:
        raise ValueError(f"expected {count} bytes, but got {len(data)}")
    return data[:count]


def write_obj(surface: Surface, path: str | os.PathLike[str]) -> None:
    """Write a surface as Wavefront OBJ, which OpenSim and MuJoCo read.

    Parameters
    ----------
    surface : vertices (vertices, 3) [m], written with eight digits
    path : of the new file, replaced where it exists

    Raises
    ------
    BadFile : the file cannot be written
    """
    path = Path(path)
    vertices = "\n".join(f"v {x:.8g} {y:.8g} {z:.8g}" for x, y, z in surface.vertices.tolist())
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in (np.asarray(surface.faces) + 1).tolist())
    try:
        path.write_text(f"{vertices}\n{faces}\n", encoding="ascii")
    except OSError as error:
        raise BadFile(path, f"cannot be written ({error.strerror or error})") from None
