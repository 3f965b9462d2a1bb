"""Small binary files of every kind, made here; those of text lie in `seeds`."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
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
TIME = np.arange(6) / 100.0


@cache
def binary_seeds() -> Mapping[str, tuple[bytes, ...]]:
    """Whole files by their ending."""
    return {
        ".c3d": (_bytes("a.c3d", _c3d), _bytes("a.c3d", _sensors)),
        ".wav": tuple(
            _wav(kind, bits) for kind, bits in ((1, 8), (1, 16), (1, 24), (3, 32), (0xFFFE, 16))
        ),
        ".stl": (_stl(),),
        ".ply": (_ply("<"), _ply(">")),
        ".bdf": (_bytes("a_emg.bdf", _emg),),
        ".edf": (_bytes("a.edf", _edf),),
        ".h5": (_bytes("a.h5", _keypoints), _bytes("a.h5", _opal)),
        ".hdf5": (_bytes("a.h5", _keypoints), _bytes("a.h5", _opal)),
        ".mat": (_bytes("a.mat", _packed), _bytes("a.mat", _unpacked)),
        ".nc": (_bytes("a.nc", _result), _bytes("a.nc", _result)[:-LENGTH]),
    }


def _bytes(name: str, write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def _emg(path: Path) -> None:
    emg = Emg(TIME, ("A", "B"), np.linspace(-1.0, 1.0, 12).reshape(6, 2))
    write_emg(path.with_name("a"), emg, ("V", "V"), {})


def _edf(path: Path) -> None:
    signals = [
        edfio.EdfSignal(np.linspace(-1.0, 1.0, 6), 100.0, label=label, physical_dimension="V")
        for label in ("A", "B")
    ]
    edfio.Edf(signals, data_record_duration=0.06).write(path)


def _opal(path: Path) -> None:
    with h5py.File(path, "w", libver="earliest") as file:
        for sensor in ("1000", "1001"):
            group = file.create_group(f"Sensors/{sensor}")
            group["Time"] = np.arange(6) * 10_000
            group["Accelerometer"] = np.linspace(-9.0, 9.0, 18).reshape(6, 3)
            group["Gyroscope"] = np.linspace(-1.0, 1.0, 18).reshape(6, 3)
            file[f"Processed/{sensor}/Orientation"] = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))


def _c3d(path: Path) -> None:
    markers = Markers(TIME, ("hip", "knee"), np.linspace(0.0, 1.0, 36).reshape(6, 2, 3))
    corners = np.array([[0.4, 0.6, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    channels = np.linspace(-1.0, 900.0, 72).reshape(12, 6)
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


def _sensors(path: Path) -> None:
    names = tuple(f"leg.{kind}.{axis}" for kind in ("ACC", "GYRO") for axis in "XYZ")
    write_trial(
        path,
        Trial(
            Markers(TIME, ("hip",), np.full((6, 1, 3), 0.5)),
            analog=Analog(
                TIME,
                names,
                np.linspace(-1.0, 1.0, 36).reshape(6, 6),
                units=("g",) * 3 + ("deg/s",) * 3,
            ),
            plate_time=TIME,
        ),
    )


def _wav(kind: int, bits: int) -> bytes:
    block = 2 * bits // 8
    form = struct.pack("<HHIIHH", kind, 2, 8000, 8000 * block, block, bits)
    form += struct.pack("<HHIH14s", 22, bits, 3, 1, b"") if kind == 0xFFFE else b""
    chunks = ((b"fmt ", form), (b"LIST", b"some"), (b"data", bytes(range(6)) * block))
    body = b"WAVE" + b"".join(name + struct.pack("<I", len(one)) + one for name, one in chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _stl() -> bytes:
    triangles = np.array(
        [[0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], [0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]], "<f4"
    )
    return (
        b"made".ljust(80)
        + struct.pack("<I", 2)
        + b"".join(one.tobytes() + b"\0\0" for one in triangles)
    )


def _ply(order: str) -> bytes:
    kind = "little" if order == "<" else "big"
    text = (SEEDS / "bone.ply").read_text(encoding="utf-8")
    head = (
        text[: text.index("end_header")].replace("ascii", f"binary_{kind}_endian") + "end_header\n"
    )
    places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], f"{order}f4").tobytes()
    return (
        head.encode()
        + places
        + b"".join(struct.pack(f"{order}Biii", 3, *one) for one in ((0, 1, 2), (0, 1, 3)))
    )


def _keypoints(path: Path) -> None:
    with h5py.File(path, "w", libver="earliest") as file:
        file["tracks"] = np.linspace(-50.0, 50.0, 36).reshape(6, 1, 2, 3)
        file["node_names"] = [b"nose", b"hip"]
        file.attrs["units"] = "mm"
        file.attrs["fps"] = 50.0


def _packed(path: Path) -> None:
    _qualisys(path, True)


def _unpacked(path: Path) -> None:
    _qualisys(path, False)


def _qualisys(path: Path, packed: bool) -> None:
    labels = np.empty((1, 2), object)
    labels[0] = ["hip", "knee"]
    data = np.linspace(-500.0, 500.0, 32).reshape(2, 4, 4)
    groups = {
        "Labeled": {"Count": 2.0, "Labels": labels, "Data": data},
        "Unidentified": {"Count": 2.0, "Data": data},
    }
    table = {"StartFrame": 1.0, "Frames": 4.0, "FrameRate": 100.0, "Trajectories": groups}
    savemat(path, {"walk": table}, do_compression=packed)


def _result(path: Path) -> None:
    with new_result(path, "ik") as result:
        result.time(TIME)
        result.names("coordinate", ("lift", "bend"))
        result.put("coordinates", ("time", "coordinate"), np.zeros((6, 2)), "rad", "angles")
        result.provenance(
            Provenance(step="ik", sources=(), options={"accuracy": 1e-5}, version="0")
        )
        result.fact("title", "walk")
