"""Binary files of every kind, made here; those of text lie in `seeds`."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

import edfio
import h5py
import numpy as np
from scipy.io import savemat

from myomorph.core.io.c3d.write import write_c3d, write_trial
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.series import Analog, Emg, Markers, PlateRecording, Trial
from myomorph.exchange.bids.recording import write_emg
from myomorph.lab.store.digests import LENGTH
from myomorph.lab.store.results import new_result

SEEDS = Path(__file__).with_name("seeds")
FRAMES = 6  # Of small files.
RATE = 100.0  # Of frames [Hz].


@cache
def binary_seeds() -> Mapping[str, tuple[bytes, ...]]:
    """Return small files by their ending."""
    return {ending: binary_files(ending, FRAMES) for ending in MAKERS}


def binary_files(ending: str, frames: int) -> tuple[bytes, ...]:
    """Return files of an ending with so many frames each, triangles of meshes."""
    files = []
    for make in MAKERS[ending]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"a_emg{ending}"
            make(path, frames)
            files.append(path.read_bytes())
    return tuple(files)


def _emg(path: Path, frames: int) -> None:
    values = np.linspace(-1.0, 1.0, 2 * frames).reshape(frames, 2)
    emg = Emg(_time(frames), ("A", "B"), values)
    write_emg(path.with_name("a"), emg, ("V", "V"), {})


def _edf(path: Path, frames: int) -> None:
    signals = [
        edfio.EdfSignal(np.linspace(-1.0, 1.0, frames), RATE, label=label, physical_dimension="V")
        for label in ("A", "B")
    ]
    edfio.Edf(signals, data_record_duration=FRAMES / RATE).write(path)


def _opal(path: Path, frames: int) -> None:
    with h5py.File(path, "w", libver="earliest") as file:
        for sensor in ("1000", "1001"):
            group = file.create_group(f"Sensors/{sensor}")
            group["Time"] = np.arange(frames) * 10_000
            group["Accelerometer"] = np.linspace(-9.0, 9.0, 3 * frames).reshape(frames, 3)
            group["Gyroscope"] = np.linspace(-1.0, 1.0, 3 * frames).reshape(frames, 3)
            file[f"Processed/{sensor}/Orientation"] = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))


def _c3d(path: Path, frames: int) -> None:
    positions = np.linspace(0.0, 1.0, 6 * frames).reshape(frames, 2, 3)
    markers = Markers(_time(frames), ("hip", "knee"), positions)
    corners = np.array([[0.4, 0.6, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    channels = np.linspace(-1.0, 900.0, 12 * frames).reshape(2 * frames, 6)
    write_c3d(
        path,
        markers,
        PlateRecording(
            name="plate",
            kind=2,
            corners=corners,
            origin=np.array([0.0, 0.0, -0.04]),
            channels=channels,
        ),
    )


def _sensors(path: Path, frames: int) -> None:
    names = tuple(f"leg.{kind}.{axis}" for kind in ("ACC", "GYRO") for axis in "XYZ")
    write_trial(
        path,
        Trial(
            Markers(_time(frames), ("hip",), np.full((frames, 1, 3), 0.5)),
            analog=Analog(
                _time(frames),
                names,
                np.linspace(-1.0, 1.0, 6 * frames).reshape(frames, 6),
                units=("g",) * 3 + ("deg/s",) * 3,
            ),
            plate_time=_time(frames),
        ),
    )


def _wav(kind: int, bits: int, path: Path, frames: int) -> None:
    block = 2 * bits // 8
    form = struct.pack("<HHIIHH", kind, 2, 8000, 8000 * block, block, bits)
    form += struct.pack("<HHIH14s", 22, bits, 3, 1, b"") if kind == 0xFFFE else b""
    chunks = (
        (b"fmt ", form),
        (b"LIST", b"some"),
        (b"data", bytes(range(6)) * (block * frames // FRAMES)),
    )
    body = b"WAVE" + b"".join(name + struct.pack("<I", len(one)) + one for name, one in chunks)
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)


def _stl(path: Path, frames: int) -> None:
    triangles = np.array(
        [[0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], [0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]], "<f4"
    )
    count = frames // 3
    pair = b"".join(one.tobytes() + b"\0\0" for one in triangles)
    path.write_bytes(b"made".ljust(80) + struct.pack("<I", count) + pair * (count // 2))


def _ply(order: str, path: Path, frames: int) -> None:
    kind = "little" if order == "<" else "big"
    text = (SEEDS / "bone.ply").read_text(encoding="utf-8")
    head = (
        text[: text.index("end_header")].replace("ascii", f"binary_{kind}_endian") + "end_header\n"
    )
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], f"{order}f4").tobytes()
    pairs = frames // FRAMES
    head = head.replace("element face 2", f"element face {2 * pairs}")
    faces = b"".join(struct.pack(f"{order}Biii", 3, *one) for one in ((0, 1, 2), (0, 1, 3)))
    path.write_bytes(head.encode() + places + faces * pairs)


def _keypoints(path: Path, frames: int) -> None:
    with h5py.File(path, "w", libver="earliest") as file:
        file["tracks"] = np.linspace(-50.0, 50.0, 6 * frames).reshape(frames, 1, 2, 3)
        file["node_names"] = [b"nose", b"hip"]
        file.attrs["units"] = "mm"
        file.attrs["fps"] = 50.0


def _packed(path: Path, frames: int) -> None:
    _qualisys(path, frames, True)


def _unpacked(path: Path, frames: int) -> None:
    _qualisys(path, frames, False)


def _qualisys(path: Path, frames: int, packed: bool) -> None:
    count = frames - 2
    labels = np.empty((1, 2), object)
    labels[0] = ["hip", "knee"]
    data = np.linspace(-500.0, 500.0, 8 * count).reshape(2, 4, count)
    groups = {
        "Labeled": {"Count": 2.0, "Labels": labels, "Data": data},
        "Unidentified": {"Count": 2.0, "Data": data},
    }
    table = {"StartFrame": 1.0, "Frames": float(count), "FrameRate": 100.0, "Trajectories": groups}
    savemat(path, {"walk": table}, do_compression=packed)


def _result(path: Path, frames: int) -> None:
    with new_result(path, "ik") as result:
        result.time(_time(frames))
        result.names("coordinate", ("lift", "bend"))
        result.put("coordinates", ("time", "coordinate"), np.zeros((frames, 2)), "rad", "angles")
        result.provenance(
            Provenance(step="ik", sources=(), options={"accuracy": 1e-5}, version="0")
        )
        result.fact("title", "walk")


def _other_result(path: Path, frames: int) -> None:
    """Write a result without its digest, as another program would."""
    _result(path, frames)
    path.write_bytes(path.read_bytes()[:-LENGTH])


def _time(frames: int) -> np.ndarray:
    """Return the times of frames [s]."""
    return np.arange(frames) / RATE


WAVES = ((1, 8), (1, 16), (1, 24), (3, 32), (0xFFFE, 16))
"""Kind of the numbers, and bits of each."""
MAKERS: Mapping[str, tuple[Callable[[Path, int], object], ...]] = {
    ".c3d": (_c3d, _sensors),
    ".wav": tuple(partial(_wav, kind, bits) for kind, bits in WAVES),
    ".stl": (_stl,),
    ".ply": (partial(_ply, "<"), partial(_ply, ">")),
    ".bdf": (_emg,),
    ".edf": (_edf,),
    ".h5": (_keypoints, _opal),
    ".hdf5": (_keypoints, _opal),
    ".mat": (_packed, _unpacked),
    ".nc": (_result, _other_result),
}
"""Writers of each ending's files."""
