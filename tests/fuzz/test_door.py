"""What no reader may do, whoever wrote the file: wait for a pipe, read without end, leave it."""

from __future__ import annotations

import base64
import os
import re
import signal
import struct
import time
import tracemalloc
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from binary_seeds import SEEDS, binary_seeds
from fuzz_readers import READERS, reader
from scipy.io import savemat

from myomorph.core.io.c3d.raw import read_raw_c3d
from myomorph.core.io.formats import read_model, read_trial
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.parsing import door
from myomorph.core.io.parsing.door import MAX_SIZES, MEBIBYTE, ROWS_AT_ONCE, within_time
from myomorph.core.io.parsing.text import unique_names
from myomorph.core.io.parsing.xml import declares_entities, read_xml
from myomorph.core.model.errors import BadFile, MyomorphError

ALONE = [each for each in READERS if not each.name.startswith("BIDS")]
"""Readers of one file: those of BIDS are given several."""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes in folders")
@pytest.mark.parametrize("each", ALONE, ids=lambda each: each.name)
def test_a_pipe_is_refused(tmp_path: Path, each) -> None:
    path = tmp_path / each.file_name
    os.mkfifo(path)

    def waited(*_):
        pytest.fail(f"{each.name} waits for a pipe")

    signal.signal(signal.SIGALRM, waited)
    signal.alarm(20)
    try:
        with pytest.raises(MyomorphError):
            each.read(path)
    finally:
        signal.alarm(0)


@pytest.mark.parametrize("each", ALONE, ids=lambda each: each.name)
def test_an_endless_file_is_refused(tmp_path: Path, each) -> None:
    path = tmp_path / each.file_name
    with path.open("wb") as stream:
        stream.truncate(max(MAX_SIZES.values()) + 1)
    with pytest.raises(MyomorphError, match="MiB allowed for"):
        each.read(path)


ROWS = (".trc", ".sto", ".mot", ".tsv", ".csv", ".txt", ".fcsv")
"""Endings of texts of rows."""
SMALL = 16 * MEBIBYTE  # Whose size is limit enough.


def with_odd_cell(content: bytes) -> bytes:
    """Return a table whose last row again has a cell that is no number."""
    last = content.rstrip().splitlines()[-1]
    return content.rstrip() + b"\n" + re.sub(rb"[^\t,; ]+$", b"n/a", last) + b"\n"


@pytest.mark.parametrize(
    "each", [each for each in READERS if each.ending.endswith(ROWS)], ids=lambda each: each.name
)
def test_rows_end_with_their_time(tmp_path: Path, monkeypatch, each) -> None:
    path = tmp_path / each.file_name
    if each in ALONE:
        with path.open("wb") as stream:
            stream.truncate(max(MAX_SIZES.values()) + 1)
        with pytest.raises(MyomorphError) as refusal:
            each.read(path)
        kind = str(refusal.value).partition("allowed for ")[2]
        if MAX_SIZES[kind] <= SMALL:
            pytest.skip(f"files of {kind} are small")
    monkeypatch.setattr(door, "MAX_SECONDS", -1.0)
    refusals = []
    for content in each.seeds():
        path.write_bytes(with_odd_cell(content))
        with pytest.raises(MyomorphError) as refusal:
            each.read(path)
        refusals.append(str(refusal.value))
    assert any("s of processor time to read" in refusal for refusal in refusals), refusals


def test_only_the_time_of_the_reading_thread_counts(monkeypatch) -> None:
    monkeypatch.setattr(door, "MAX_SECONDS", 0.05)
    rows = within_time(range(10 * ROWS_AT_ONCE), Path("rows.csv"))
    with ThreadPoolExecutor(1) as pool:
        # Whoever waits for others uses no time of its own.
        for _ in rows:
            pool.submit(sum, range(10_000)).result()
            break
        time.sleep(0.1)
        assert next(rows) == 1
        busy = pool.submit(lambda: [sum(range(10_000)) for _ in within_time(range(10**6), Path())])
        with pytest.raises(BadFile, match=r"more than 0\.05 s of processor time to read \(row"):
            busy.result()
    assert sum(1 for _ in rows) == 10 * ROWS_AT_ONCE - 2


def _external_link(file: h5py.File, elsewhere: Path) -> None:
    file["group/values"] = h5py.ExternalLink(str(elsewhere), "/secret")


def _external_storage(file: h5py.File, elsewhere: Path) -> None:
    file.create_dataset("stored", (4,), "f8", external=[(str(elsewhere), 0, 32)])


def _virtual(file: h5py.File, elsewhere: Path) -> None:
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(str(elsewhere), "secret", (4,))
    file.create_virtual_dataset("virtual", layout)


@pytest.mark.parametrize("lead_out", [_external_link, _external_storage, _virtual])
@pytest.mark.parametrize("name", ["keypoints, .h5", "APDM, .h5", "results, NetCDF"])
def test_no_file_is_read_that_another_leads_to(tmp_path: Path, lead_out, name) -> None:
    elsewhere = tmp_path / "elsewhere.h5"
    with h5py.File(elsewhere, "w") as file:
        file["secret"] = np.arange(4.0)
    path = tmp_path / reader(name).file_name
    with h5py.File(path, "w") as file:
        file["tracks"] = np.zeros((6, 1, 2, 3))
        lead_out(file, elsewhere)
    with pytest.raises(BadFile, match="lies in another file"):
        reader(name).read(path)


def _with_records(record: bytes, count: int) -> bytes:
    """Return a C3D file that begins its parameters with copies of a record."""
    content = binary_seeds()[".c3d"][0]
    start = 512 * (content[0] - 1) + 4
    return content[:start] + record * count + content[start:]


def test_parameters_of_c3d_that_share_their_bytes(tmp_path: Path) -> None:
    """Each of many small records claims the megabyte behind it."""
    record = struct.pack("<bb1shbb3B", 1, 1, b"A", 7, 1, 3, 255, 255, 15)
    (tmp_path / "a.c3d").write_bytes(_with_records(record, 20_000))
    tracemalloc.start()
    try:
        trial = read_trial(tmp_path / "a.c3d")
        assert tracemalloc.get_traced_memory()[1] < 2**28
    except BadFile:
        assert tracemalloc.get_traced_memory()[1] < 2**28
    else:
        assert len(trial.warnings) < 30
    finally:
        tracemalloc.stop()


def test_many_broken_parameters_of_c3d_are_one_message(tmp_path: Path) -> None:
    record = struct.pack("<bb1shbb", 1, 1, b"A", 4, 3, 0)
    for count in (3, 5_000):
        (tmp_path / "a.c3d").write_bytes(_with_records(record, count))
        remarks = [str(each) for each in read_raw_c3d(tmp_path / "a.c3d").remarks]
        about = [text for text in remarks if "left out" in text]
        assert len(about) == (3 if count == 3 else 1), about[:3]
        assert count == 3 or "5000 parameters" in about[0]


def test_a_packed_matlab_file_of_zeros(tmp_path: Path) -> None:
    frames = 70_000
    groups = {"Labeled": {"Labels": "a", "Data": np.zeros((240, 4, frames), np.float32)}}
    savemat(
        tmp_path / "a.mat",
        {"walk": {"FrameRate": 100.0, "Trajectories": groups}},
        do_compression=True,
    )
    assert (tmp_path / "a.mat").stat().st_size < 2**20
    with pytest.raises(BadFile, match="holds more than"):
        read_trial(tmp_path / "a.mat")


def _vtp(points: str, polygons: str, attributes: str = "") -> str:
    return (
        f'<VTKFile type="PolyData" {attributes}><PolyData><Piece><Points>{points}</Points>'
        f"<Polys>{polygons}</Polys></Piece></PolyData></VTKFile>"
    )


def test_a_packed_mesh_of_zeros(tmp_path: Path) -> None:
    block = zlib.compress(bytes(MAX_SIZES["a mesh"] + 4), 9)
    head = np.array([1, len(block), 0, len(block)], "<u4").tobytes()
    array = (base64.b64encode(head) + base64.b64encode(block)).decode()
    points = f'<DataArray type="Float32" format="binary">{array}</DataArray>'
    attributes = 'compressor="vtkZLibDataCompressor"'
    (tmp_path / "a.vtp").write_text(_vtp(points, "", attributes), encoding="utf-8")
    with pytest.raises(BadFile, match="MiB of numbers"):
        read_mesh(tmp_path / "a.vtp")


def test_polygons_that_share_all_corners(tmp_path: Path) -> None:
    count = 3000
    corners = " ".join(["0"] * count)
    ends = f"{count} 0 " * count
    points = '<DataArray type="Float32" format="ascii">0 0 0</DataArray>'
    polygons = (
        f'<DataArray Name="connectivity" type="Int64" format="ascii">{corners}</DataArray>'
        f'<DataArray Name="offsets" type="Int64" format="ascii">{ends}</DataArray>'
    )
    (tmp_path / "a.vtp").write_text(_vtp(points, polygons), encoding="utf-8")
    with pytest.raises(BadFile, match="offsets do not rise"):
        read_mesh(tmp_path / "a.vtp")


def test_a_mesh_that_counts_more_than_it_has(tmp_path: Path) -> None:
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\n"
    (tmp_path / "a.ply").write_text(f"{head}end_header\n", encoding="utf-8")
    with pytest.raises(BadFile, match="more than its bytes"):
        read_mesh(tmp_path / "a.ply")


def test_a_height_field_beyond_all_memory(tmp_path: Path) -> None:
    field = '<hfield name="hills" nrow="40000" ncol="40000" size="1 1 1 1"/>'
    (tmp_path / "a.xml").write_text(f"<mujoco><asset>{field}</asset></mujoco>", encoding="utf-8")
    with pytest.raises(BadFile, match="'hills' has 40000 x 40000 cells"):
        read_model(tmp_path / "a.xml")


def test_a_height_field_in_a_file_beyond_all_memory(tmp_path: Path) -> None:
    size = np.array([40000, 40000], ">i4").tobytes()
    (tmp_path / "hills.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + size + bytes(40))
    field = '<hfield name="hills" file="hills.png" size="1 1 1 1"/>'
    (tmp_path / "a.xml").write_text(f"<mujoco><asset>{field}</asset></mujoco>", encoding="utf-8")
    with pytest.raises(BadFile, match="40000 x 40000 cells"):
        read_model(tmp_path / "a.xml")


def test_sensors_times_frames_beyond_all_memory(tmp_path: Path) -> None:
    sensors = '<sensor label="a"/>' * 6000
    frame = "<frame time='{}'><sensorOrientation>1 0 0 0</sensorOrientation></frame>"
    frames = "".join(frame.format(index) for index in range(6000))
    text = f"<mvnx><subject><sensors>{sensors}</sensors><frames>{frames}</frames></subject></mvnx>"
    (tmp_path / "a.mvnx").write_text(text, encoding="utf-8")
    with pytest.raises(BadFile, match="too many to read"):
        reader("Xsens MVN, .mvnx").read(tmp_path / "a.mvnx")


@pytest.mark.parametrize(
    ("rate", "time", "words"),
    [("x", "", "frame 0 has no time"), ("0", "", "frame 0 has no time"), ("60", "x", "frame 0")],
)
def test_frames_without_times_are_named(tmp_path: Path, rate, time, words) -> None:
    frame = f"<frame time='{time}'><sensorOrientation>1 0 0 0</sensorOrientation></frame>"
    text = f"<mvnx><subject frameRate='{rate}'><sensor label='a'/>{frame}</subject></mvnx>"
    (tmp_path / "a.mvnx").write_text(text, encoding="utf-8")
    with pytest.raises(BadFile, match=words):
        reader("Xsens MVN, .mvnx").read(tmp_path / "a.mvnx")


def test_equal_names_are_numbered() -> None:
    names = unique_names(["a", "a_2", "a", "b", "a", "b"], "column", [])
    assert names == ("a", "a_2", "a_3", "b", "a_4", "b_2")
    assert len(set(unique_names(["a"] * 20_000, "column", []))) == 20_000


def test_comments_are_taken_out_of_xml_that_needs_repair(tmp_path: Path) -> None:
    text = "<a><!-- one & -- two --><b>1 & 2</b>\n<!-- x\ny --><c/></a>"
    (tmp_path / "a.xml").write_text(text, encoding="utf-8")
    root = read_xml(tmp_path / "a.xml").root
    assert [child.tag for child in root] == ["b", "c"]
    assert root[0].text == "1 & 2"
    assert root[1].sourceline == 3


@pytest.mark.parametrize(
    ("text", "declares"),
    [
        ("<!DOCTYPE a><b/>", False),
        ("<!DOCTYPE a [<!ENTITY x 'y'>]><b/>", True),
        ("<!DOCTYPE a [ ]><b/>", True),
        ("<!  entity x 'y'>", True),
        ("<!DOCTYPE a SYSTEM 'x.dtd'><b/>[", False),
        ("<!DOCTYPE " * 9, False),
    ],
)
def test_entities_are_found(text: str, declares: bool) -> None:
    assert declares_entities(text.encode("utf-8")) is declares
    assert declares_entities(text.encode("utf-16")) is declares


@pytest.mark.parametrize("lines", [1, 2])
@pytest.mark.parametrize("name", ["apdm.csv", "apdm_older.csv"])
def test_a_table_of_sensors_that_ends_within_its_head(
    tmp_path: Path, name: str, lines: int
) -> None:
    content = (SEEDS / name).read_bytes().splitlines(keepends=True)
    (tmp_path / name).write_bytes(b"".join(content[:lines]))
    with pytest.raises(MyomorphError):
        reader("Movella DOT, APDM or Delsys, .csv").read(tmp_path / name)


@pytest.mark.parametrize("rate", ["1.2.3", "..", "0", "0.0"])
def test_a_rate_of_sensors_that_is_none(tmp_path: Path, rate: str) -> None:
    content = (SEEDS / "xsens.txt").read_text(encoding="utf-8")
    odd, count = re.subn(r"(Update\s*Rate:?[,\s]*)[\d.]+", rf"\g<1>{rate}", content)
    assert count == 1
    (tmp_path / "xsens.txt").write_text(odd, encoding="utf-8")
    with suppress(MyomorphError):
        reader("Xsens MT Manager, .txt").read(tmp_path / "xsens.txt")
