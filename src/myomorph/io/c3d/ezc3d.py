"""C3D by the ezc3d library, in a child process: it hangs on some broken files and crashes on others."""

from __future__ import annotations

import importlib.util
import json
import tempfile
from pathlib import Path

import numpy as np

from myomorph.io.c3d.plain import RawC3d, Value
from myomorph.io.parsing.guard import GIGABYTE, run_guarded, seconds_for


def has_ezc3d() -> bool:
    """Whether the library is installed: there is none for Windows and Linux on ARM."""
    return importlib.util.find_spec("ezc3d") is not None


def read_c3d_ezc3d(path: Path) -> RawC3d | str:
    """Read a C3D file with ezc3d in a child process; a text says why it could not."""
    gigabytes = 4.0 + 40.0 * path.stat().st_size / GIGABYTE
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        target = Path(folder) / "c3d.npz"
        outcome = run_guarded(f"{__name__}:_save_arrays", [path.resolve(), target], seconds_for(path), gigabytes)
        if outcome.status != "done" or not target.exists():
            return outcome.message or "gave no result"
        with np.load(target) as arrays:
            about = json.loads(str(arrays["about"]))
            points, residuals, analog = arrays["points"], arrays["residuals"], arrays["analog"]
    groups: dict[str, dict[str, Value]] = {
        group: {name: _value(value) for name, value in parameters.items()}
        for group, parameters in about["groups"].items()
    }
    return RawC3d(
        groups=groups,
        first_frame=about["first_frame"],
        point_rate=about["point_rate"],
        analog_rate=about["analog_rate"],
        points=points,
        residuals=residuals,
        analog=analog,
        events=tuple((label, time) for label, time in about["events"]),
        reader=f"ezc3d {about['version']}",
    )


def _value(stored: dict[str, list]) -> Value:
    if "texts" in stored:
        return tuple(stored["texts"])
    return np.array(stored["numbers"], dtype=np.float64).reshape(stored["shape"])


def _stored(value: object) -> dict[str, object]:
    if isinstance(value, (list, tuple)) and all(isinstance(one, str) for one in value) and value:
        return {"texts": list(value)}
    numbers = np.asarray(value if value is not None else [], dtype=np.float64)
    return {"numbers": numbers.ravel().tolist(), "shape": list(numbers.shape)}


def _save_arrays(source: str, target: str) -> None:
    """The child's side of reading: a C3D file as plain arrays."""
    # Brings ezc3d: loaded only where it is needed.
    import ezc3d

    file = ezc3d.c3d(source, extract_forceplat_data=False)
    header, parameters, samples = file["header"], file["parameters"], file["data"]
    groups: dict[str, dict[str, object]] = {}
    for group in parameters:
        groups[group.upper()] = {}
        for name, parameter in parameters[group].items():
            if name.startswith("__"):
                continue
            try:
                groups[group.upper()][name.upper()] = _stored(parameter["value"])
            except (ValueError, TypeError):
                continue
    events = header.get("events", {})
    labels, times = events.get("events_label", ()), np.ravel(events.get("events_time", ()))
    about = {
        "groups": groups,
        "first_frame": int(header["points"]["first_frame"]) + 1,
        "point_rate": float(header["points"]["frame_rate"]),
        "analog_rate": float(header["analogs"]["frame_rate"]),
        "events": [(str(label), float(time)) for label, time in zip(labels, times, strict=False)],
        "version": ezc3d.__version__,
    }
    points = samples["points"][:3].transpose(2, 1, 0)
    residuals = samples["meta_points"]["residuals"][0].T
    analog = samples["analogs"][0].T
    np.savez(target, about=np.array(json.dumps(about)), points=points, residuals=residuals, analog=analog)
