"""Meshes of bones and skins: VTP, OBJ, STL and PLY files, looked up only inside given folders."""

from __future__ import annotations

import base64
import io
import logging
import os
import re
import warnings
import zlib
from collections.abc import Iterable, Iterator, KeysView, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from lxml import etree

from myomorph.core.io.parsing.door import MAX_SIZES, check_file, content_of
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.io.parsing.xml import declares_entities, read_xml
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadFile, MyomorphError, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface

ENDINGS = (".vtp", ".obj", ".stl", ".ply")
PLY_HEAD = 65536  # Bytes in which the head of a PLY file ends.
STL_HEAD = 84  # Bytes; the last four count the triangles.
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
"""A triangle of a binary STL file, of which it holds as many as its bytes 80 to 83 say."""
_TYPES = {
    "Float32": "f4",
    "Float64": "f8",
    "Int8": "i1",
    "Int16": "i2",
    "Int32": "i4",
    "Int64": "i8",
    "UInt8": "u1",
    "UInt16": "u2",
    "UInt32": "u4",
    "UInt64": "u8",
}
"""VTK's types of numbers, as NumPy names them."""


def mesh_files(model: Model) -> KeysView[str]:
    """List the files of meshes that a model draws its bodies with, each once and in order.

    Parameters
    ----------
    model : its bodies' meshes are read

    Returns
    -------
    names as the model has them
    """
    meshes = [mesh for body in model.bodies for mesh in body.meshes]
    return dict.fromkeys(mesh.file for mesh in meshes if mesh.shape == "mesh" and mesh.file).keys()


def mesh_folders(model: Model) -> list[Path]:
    """List the folders in which the meshes of a model may lie: beside its file, and `Geometry`.

    Parameters
    ----------
    model : with the path of the file that it was read from

    Returns
    -------
    those that exist; none of a model that no file is known of
    """
    source = Path(model.source)
    if not model.source or not source.parent.is_dir():
        return []
    folders = [source.parent, source.parent / "Geometry", source.parent / "geometry"]
    return [folder for folder in folders if folder.is_dir()]


def read_surfaces(
    model: Model, folders: Sequence[str | Path], root: str | Path | None = None
) -> tuple[dict[str, Surface], tuple[Message, ...]]:
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
    names = mesh_files(model)
    surfaces: dict[str, Surface] = {}
    refused = []
    missing = []
    warnings: list[Message] = []
    for name in names:
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
            warnings.append(MODEL.message(str(error)))
    if refused:
        warnings.append(
            MODEL.message(
                f"mesh files outside the model's folder are not opened: {quoted(refused, 4)}"
            )
        )
    if missing:
        where = ", ".join(str(folder) for folder in folders) or "no folder"
        warnings.append(
            MODEL.message(
                f"{len(missing)} of {len(names)} mesh files are not in {where}:"
                f" {quoted(missing, 4)}"
            )
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
        if is_named_file(path):
            return path
        other_case = _in_other_case(path, border)
        if other_case is not None:
            return other_case
    return None


def _in_other_case(path: Path, border: Path) -> Path | None:
    """Find a file whose name differs from a path in the case of letters, inside a folder."""
    if not path.parent.is_dir():
        return None
    for file in path.parent.iterdir():
        same_name = file.name.lower() == path.name.lower()
        if same_name and file.resolve().is_relative_to(border) and is_named_file(file):
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
    check_file(path, "a mesh")
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
    content = content_of(path, "a mesh")
    if kind == "stl" and _is_binary_stl(content):
        triangles = np.frombuffer(content, STL_FACE, offset=STL_HEAD)
        corners = triangles["corners"].reshape(-1, 3)
        return merged(corners, np.arange(len(corners)).reshape(-1, 3))
    if kind == "ply":
        _check_ply(content)
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


def _check_ply(content: bytes) -> None:
    """Check that a PLY file is as long as what its head counts; `ValueError` where it is not."""
    head = content[: content.find(b"end_header") + 1 or PLY_HEAD]
    count = sum(map(int, re.findall(rb"(?m)^\s*element\s+\S+\s+(\d{1,18})\b", head)))
    if count > len(content):
        raise ValueError(f"its head counts {count} elements, more than its bytes")


def _is_binary_stl(content: bytes) -> bool:
    """Return whether a file has the size of as many triangles as its head counts, at least one."""
    count = int.from_bytes(content[STL_HEAD - 4 : STL_HEAD], "little")
    return count > 0 and len(content) == STL_HEAD + STL_FACE.itemsize * count


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
    file = _vtp_file(path)
    document = file.document
    if document is None or document.tag != "VTKFile" or document.get("type") != "PolyData":
        raise BadFile(path, "is not a VTP file", 'expected <VTKFile type="PolyData">')
    reader = _Arrays(document, file.appended, file.raw)
    vertices = []
    faces = []
    count = 0
    for piece in document.iter("Piece"):
        points = reader.array(piece.find("Points/DataArray")).reshape(-1, 3)
        for triangles in _triangles(piece, reader):
            faces.append(triangles + count)
        vertices.append(points)
        count += len(points)
    if not vertices or not faces:
        raise BadFile(path, "holds no polygons")
    return Surface(np.concatenate(vertices), np.concatenate(faces))


@dataclass(frozen=True, kw_only=True)
class _VtpFile:
    """Parts of a VTP file.

    Attributes
    ----------
    document : outermost element, None where nothing could be parsed
    appended : bytes behind the mark of the appended data
    raw : whether these are bytes, not base64
    """

    document: etree._Element | None
    appended: bytes = b""
    raw: bool = False


def _vtp_file(path: Path) -> _VtpFile:
    """Read a file as XML, its appended data apart: raw bytes are no XML.

    Raises
    ------
    BadFile : it is not XML, or declares entities
    """
    content = content_of(path, "a mesh")
    mark = re.search(rb"<AppendedData[^>]*>", content)
    if mark is None:
        return _VtpFile(document=read_xml(path).root)
    before = content[: mark.end()]
    if declares_entities(content[: mark.start()]):
        raise BadFile(path, "declares XML entities, which could expand without end")
    end_mark = b"</AppendedData>"
    end = content.rfind(end_mark)
    if end > 0:
        appended = content[mark.end() : end]
        behind = content[end + len(end_mark) :]
    else:
        appended = content[mark.end() :]
        behind = b""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False, recover=True
    )
    return _VtpFile(
        document=etree.fromstring(before + end_mark + behind, parser),
        appended=appended.lstrip()[1:],
        raw=b'encoding="raw"' in mark[0],
    )


def _triangles(piece: etree._Element, reader: _Arrays) -> Iterator[np.ndarray]:
    """Yield the polygons and the strips of a piece as triangles (triangles, 3), if it has any."""
    for name, split in (("Polys", _fans), ("Strips", _strips)):
        group = piece.find(name)
        elements = [] if group is None else group.findall("DataArray")
        arrays = {element.get("Name"): element for element in elements}
        if "connectivity" not in arrays or "offsets" not in arrays:
            continue
        corners = reader.array(arrays["connectivity"]).astype(np.int64)
        ends = reader.array(arrays["offsets"]).astype(np.int64)
        if len(ends):
            if ends[0] < 0 or (np.diff(ends) < 0).any() or ends[-1] > len(corners):
                raise ValueError("offsets do not rise, or pass the corners")
            yield split(corners, ends)


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
    counts = np.maximum(ends - starts - 2, 0)
    first = np.repeat(starts, counts)
    before = np.repeat(np.cumsum(counts) - counts, counts)
    index = np.arange(counts.sum()) - before + 1
    fan = [corners[first], corners[first + index], corners[first + index + 1]]
    # The first triangle of each polygon, then the second of each, and so on.
    return np.stack(fan, axis=1)[np.argsort(index, kind="stable")]


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
    starts = np.concatenate([[0], ends[:-1]])
    triangles = []
    for start, end in zip(starts, ends, strict=True):
        strip = corners[start:end]
        of_strip = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
        of_strip[1::2] = of_strip[1::2, ::-1]
        triangles.append(of_strip)
    return _joined(triangles)


def _joined(triangles: Sequence[np.ndarray]) -> np.ndarray:
    """Concatenate arrays of triangles (triangles, 3), of which there may be none."""
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
        self.size = 0  # Bytes of all numbers that were read.

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
            return self._counted(_ascii(element.text or "", kind))
        if form == "appended":
            data = memoryview(self.appended)[int(element.get("offset", "0")) :]
            return self._decoded(data, self.order + kind, self.raw)
        text = "".join((element.text or "").split()).encode()
        return self._decoded(memoryview(text), self.order + kind, False)

    def _counted(self, numbers: np.ndarray) -> np.ndarray:
        """Return numbers as they are; `ValueError` where all that was read is too much."""
        self.size += numbers.nbytes
        if self.size > MAX_SIZES["a mesh"]:
            raise ValueError(f"more than {MAX_SIZES['a mesh'] >> 20} MiB of numbers")
        return numbers

    def _decoded(self, data: memoryview, kind: str, raw: bool) -> np.ndarray:
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
        ValueError : it is cut off or too large, or its compressor is unknown
        """
        size = np.dtype(self.header).itemsize
        if not self.compressor:
            count = int(np.frombuffer(_bytes(data, size, raw), self.header, 1)[0])
            body = _bytes(data, size + count, raw)[size:]
            return self._counted(np.frombuffer(body, kind))
        if self.compressor != "vtkZLibDataCompressor":
            raise ValueError(f"compressor {self.compressor}")
        # Count of blocks, sizes of a block and of the last one before they were compressed, and
        # the compressed size of each.
        count = 3 + int(np.frombuffer(_bytes(data, size, raw), self.header, 1)[0])
        head = _bytes(data, size * count, raw)
        sizes = np.frombuffer(head, self.header, count)[3:].astype(np.int64)
        begin = size * count if raw else _padded(size * count)
        body = _bytes(data[begin:], int(sizes.sum()), raw)
        parts = []
        for end, length in zip(np.cumsum(sizes), sizes, strict=True):
            parts.append(self._unpacked(body[end - length : end]))
        return np.frombuffer(b"".join(parts), kind)

    def _unpacked(self, block: bytes) -> bytes:
        """Unpack a block; `ValueError` where it is too large."""
        stream = zlib.decompressobj()
        content = stream.decompress(block, MAX_SIZES["a mesh"] - self.size + 1)
        self._counted(np.frombuffer(content, np.uint8))
        return content


def _ascii(text: str, kind: str) -> np.ndarray:
    """Read numbers in plain text (numbers,); `ValueError` where another word is among them."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except DeprecationWarning as error:
            raise ValueError(str(error)) from None


def _bytes(data: memoryview, count: int, raw: bool) -> bytes:
    """Return the first bytes of data, of base64 or raw; `ValueError` where there are fewer."""
    if count < 0 or count > len(data):
        raise ValueError(f"expected {count} bytes, but got {len(data)}")
    part = bytes(data[:count]) if raw else base64.b64decode(bytes(data[: _padded(count)]))
    if len(part) < count:
        raise ValueError(f"expected {count} bytes, but got {len(part)}")
    return part[:count]


def _padded(size: int) -> int:
    """Return how many characters base64 needs for so many bytes."""
    return 4 * ((size + 2) // 3)


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
    vertices = [f"v {x:.8g} {y:.8g} {z:.8g}" for x, y, z in surface.vertices.tolist()]
    # Indices count from 1.
    faces = [f"f {a} {b} {c}" for a, b, c in (np.asarray(surface.faces) + 1).tolist()]
    vertex_lines = "\n".join(vertices)
    face_lines = "\n".join(faces)
    try:
        path.write_text(f"{vertex_lines}\n{face_lines}\n", encoding="ascii")
    except OSError as error:
        raise BadFile(path, f"cannot be written ({error.strerror or error})") from None
