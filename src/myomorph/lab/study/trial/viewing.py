"""From folders of results to a page that plays them again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.results import DAMAGED, read_result, result_files

if TYPE_CHECKING:
    from myomorph.lab.report.trial.report_input import ReportInput
    from myomorph.lab.study.trial.reporting import ModelMaker
    from myomorph.lab.viewer.replay import Replay

# Variables of result files that hold a motion.
MOTIONS = ("coordinate_value", "coordinate_filtered")

LARGE = ("moment_arm",)  # Variables that a page does not show.


Recordings = Mapping[str, Callable[[], "ReportInput"]]  # By name, each opened when it is called.


def open_replay(
    folders: Sequence[str | Path],
    port: int | None = None,
    served: Callable[[int], None] | None = None,
    demo_model: ModelMaker | None = None,
    others: Callable[[Path], Recordings] = lambda folder: {},
) -> Replay:
    """A page, on a free port by default, that shows the results (with a motion) of one folder or
    file, or of several in one scene; `served` is called with the port once the page can be opened,
    before the results are read; `others`: finds recordings of folders of another kind.
    """
    choices = [others(Path(folder)) or recordings(folder, demo_model) for folder in folders]
    from myomorph.lab.viewer.replay import Replay

    return Replay(choices, port, served)


def recordings(folder: str | Path, demo_model: ModelMaker | None = None) -> Recordings:
    """The recordings of a folder of results by name, each opened when it is called; those with a
    motion. Files in one folder belong together where they tell of the same trial at the same times.
    """
    folder = Path(folder)
    groups: dict[tuple[object, ...], list[Path]] = {}
    moving: set[tuple[object, ...]] = set()
    for path in result_files(folder):
        key, has_motion = _what_is_in(path)
        if key is not None:
            groups.setdefault(key, []).append(path)
            moving |= {key} if has_motion else set()
    shown = {key: files for key, files in groups.items() if key in moving}
    if not shown:
        raise BadFile(
            folder,
            "holds results, but none with a motion",
            "give the --out of ik, run, muscles or tension",
        )
    result: dict[str, Callable[[], ReportInput]] = {}
    for (home, trial, *_), files in shown.items():
        place = Path(str(home)).relative_to(folder if folder.is_dir() else folder.parent)
        name = (
            str(place)
            if len(place.parts) and place.name == trial
            else str(place / str(trial or files[0].stem))
        )
        while name in result:
            name += "'"
        result[name] = partial(_open, tuple(files), demo_model)
    return result


def _open(files: Sequence[Path], demo_model: ModelMaker | None) -> ReportInput:
    # The page is served already: what takes longest to import comes last.
    from myomorph.lab.study.trial.reporting import joined, model_of, report_input

    stored = joined([read_result(path, leave_out=LARGE) for path in files])
    return report_input(stored, model_of(stored, demo_model))


def _what_is_in(path: Path) -> tuple[tuple[object, ...] | None, bool]:
    """Folder, trial, number of frames and ends of a result's time, or None; and whether it holds a
    motion.
    """
    try:
        with open_netcdf(path) as file:
            variables = dict(file.data())
            if "time" not in variables:
                return None, False
            time = variables["time"]
            ends = (float(time[0]), float(time[-1])) if time.shape[0] else ()
            trial = file.attributes.get("trial", "")
            return (path.parent, trial, time.shape[0], *ends), any(
                name in variables for name in MOTIONS
            )
    except DAMAGED as error:
        raise BadFile(
            path, f"is not a result of Myomorph ({error})", "give a folder that a step wrote"
        ) from None
