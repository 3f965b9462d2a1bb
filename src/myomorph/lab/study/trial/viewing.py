"""From folders of results to a page that plays them again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.netcdf import open_netcdf
from myomorph.lab.store.results import DAMAGED, read_result, result_files

if TYPE_CHECKING:
    from myomorph.core.model.model import Model
    from myomorph.lab.report.trial.report_input import ReportInput
    from myomorph.lab.study.trial.reporting import ModelMaker
    from myomorph.lab.viewer.replay import Replay

# Variables of result files that hold a motion.
MOTIONS = ("coordinate_value", "coordinate_filtered")

LARGE = ("moment_arm",)  # Variables that a page does not show.


Recordings = Mapping[str, Callable[[], "ReportInput"]]  # By name, each opened when it is called.


@dataclass(frozen=True, kw_only=True)
class Appearance:
    """What results are shown with, beside what they hold.

    Attributes
    ----------
    demo_model : makes the model of a demonstration's results, by its name
    geometry : folder of meshes, looked into before those beside the model
    missing : called with a sentence for each kind of meshes that are not shown
    """

    demo_model: ModelMaker | None = None
    geometry: Path | None = None
    missing: Callable[[str], None] = lambda sentence: None

    def __post_init__(self) -> None:
        if self.geometry is not None and not self.geometry.is_dir():
            raise BadFile(self.geometry, "is no folder", "give the one that holds the meshes")


AS_STORED = Appearance()


def open_replay(
    folders: Sequence[str | Path],
    port: int | None = None,
    served: Callable[[str], None] | None = None,
    appearance: Appearance = AS_STORED,
    others: Callable[[Path], Recordings] = lambda folder: {},
) -> Replay:
    """Open a page that shows the results (with a motion) of one folder or file.

    Several are shown in one scene. The page is on a free port by default; `served` is called with
    the address once it can be opened, before the results are read; `others`: finds recordings of
    folders of another kind.
    """
    choices = [others(Path(folder)) or recordings(folder, appearance) for folder in folders]
    from myomorph.lab.viewer.replay import Replay

    return Replay(choices, port, served)


def recordings(folder: str | Path, appearance: Appearance = AS_STORED) -> Recordings:
    """Return the recordings of a folder of results by name, each opened when it is called.

    They are those with a motion. Files in one folder belong together where they are of the same
    trial at the same times.
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
        result[name] = partial(_open, tuple(files), appearance)
    return result


def _open(files: Sequence[Path], appearance: Appearance) -> ReportInput:
    # The page is served already: what takes longest to import comes last.
    from myomorph.lab.study.trial.reporting import joined, model_of, report_input

    stored = joined([read_result(path, leave_out=LARGE) for path in files])
    model = model_of(stored, appearance.demo_model)
    return _with_meshes(report_input(stored, model, drawn=False), model, appearance)


def _with_meshes(shown: ReportInput, model: Model, appearance: Appearance) -> ReportInput:
    """Return what is shown with its meshes, and a warning of those that are missing."""
    from myomorph.core.io.mesh import mesh_folders, read_surfaces
    from myomorph.lab.study.trial.reporting import reduced_for_pictures

    own = () if appearance.geometry is None else (appearance.geometry,)
    surfaces, missing = read_surfaces(model, (*own, *mesh_folders(model)))
    sentences = [
        text.changed(f"{text}: name the folder that has them by --geometry") for text in missing
    ]
    for sentence in sentences:
        appearance.missing(sentence)
    return replace(shown, surfaces=reduced_for_pictures(surfaces)).with_warnings(sentences)


def _what_is_in(path: Path) -> tuple[tuple[object, ...] | None, bool]:
    """Return folder, trial, number of frames and ends of a result's time, or None.

    It also returns whether the result holds a motion.
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
    except BadFile:
        raise
    except DAMAGED as error:
        raise BadFile(
            path, f"is not a result of Myomorph ({error})", "give a folder that a step wrote"
        ) from None
