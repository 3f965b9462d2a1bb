"""Markers and a force plate as C3D, by the ezc3d library in a child process.

In one process with OpenSim's Python module, whose wrapper shares names with its own, ezc3d cannot write.

`python -m myomorph.io.c3d.write IN.npz OUT.c3d` is the child's side.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from myomorph.io.parsing.guard import run_guarded
from myomorph.model.errors import BadData, BadFile
from myomorph.model.series import Markers, PlateRecording

SECONDS = 120.0


def write_c3d(path: str | os.PathLike[str], markers: Markers, plate: PlateRecording | None = None) -> None:
    """Write markers [mm] and a plate of type 2, forces [N] and moments [N mm], a whole number of samples a frame.

    Raises
    ------
    BadData
        The plate is of another type, or has fewer samples than frames.
    BadFile
        The file cannot be written.
    """
    arrays = {
        "names": np.array(markers.names),
        "rate": np.array(round(1.0 / float(np.median(np.diff(markers.time))), 3)),
        "points": 1000.0 * markers.values,
    }
    if plate is not None:
        every = len(plate.channels) // len(markers)
        if plate.kind != 2 or every < 1:
            raise BadData(
                f"plate '{plate.name}' of type {plate.kind} has {len(plate.channels)} samples for {len(markers)} "
                "frames: plates of type 2 with a sample a frame or more can be written"
            )
        arrays["channels"] = plate.channels[: every * len(markers)] * ([1.0] * 3 + [1000.0] * 3)
        arrays |= {"every": np.array(every), "corners": 1000.0 * plate.corners, "origin": 1000.0 * plate.origin}
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        source, made = Path(folder) / "recording.npz", Path(folder) / "recording.c3d"
        np.savez(source, **arrays)  # type: ignore[arg-type]
        outcome = run_guarded("myomorph.io.c3d.write", [str(source), str(made)], SECONDS)
        if outcome.status != "done":
            raise BadFile(path, f"cannot be written ({outcome.message})")
        try:
            shutil.move(made, path)
        except OSError as error:
            raise BadFile(path, f"cannot be written ({error.strerror or error})") from None


def _convert(source: str, target: str) -> None:
    """The child's work."""
    import ezc3d

    file = ezc3d.c3d()
    parameters = file["parameters"]
    with np.load(source) as given:
        frames, names = len(given["points"]), given["names"].tolist()
        points = np.ones((4, len(names), frames))
        points[:3] = given["points"].transpose(2, 1, 0)
        for name, value in (("UNITS", ["mm"]), ("RATE", [float(given["rate"])]), ("LABELS", names)):
            parameters["POINT"][name]["value"] = value
        file["data"]["points"] = points
        if "channels" in given:
            labels, units = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"], ["N"] * 3 + ["Nmm"] * 3
            rate = float(given["every"] * given["rate"])
            for name, value in (("UNITS", units), ("RATE", [rate]), ("LABELS", labels)):
                parameters["ANALOG"][name]["value"] = value
            file["data"]["analogs"] = given["channels"].T[None]
            for name, value in (
                ("USED", [1]),
                ("TYPE", [2]),
                ("ZERO", [1, 0]),
                ("CORNERS", given["corners"].T[:, :, None]),
                ("ORIGIN", given["origin"][:, None]),
                ("CHANNEL", np.arange(1.0, 7.0)[:, None]),
            ):
                file.add_parameter("FORCE_PLATFORM", name, value)
    file.write(target)


def _main() -> int:
    try:
        _convert(*sys.argv[1:3])
    except Exception as error:
        sys.stderr.write(" ".join(str(error).split())[:300] + "\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(_main())
