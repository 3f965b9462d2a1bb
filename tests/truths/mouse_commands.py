"""The mouse's recordings by one study file, as a user would write it.

Nothing but the model is prepared.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import myomorph as mm
from myomorph.core.io.osim.write import write_osim
from myomorph.core.tension.tension import Tension
from myomorph.lab.report.trial.summary_lines import residual_verdict, tension_line
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from truths.mouse_recordings import GAIT_LABELS, LOOSE, both_hindlimbs, gait_files

STUDY = """
[study]
name = "mice"
[groups]
marked = {marked}
unmarked = {unmarked}
{subjects}
[options.ik]
passes_only = true
"""
SUBJECT = """
[[subject]]
name = "{name}"
model = "mouse.osim"
trials = ["{recording}"]
tasks = "tasks.xml"
steps = {steps}
labels = {{ {labels} }}
{contacts}
"""
STEPS = ("calibrate", "ik", "id", "tension", "report")
TASK = "<IKMarkerTask name='{}'><apply>true</apply><weight>{}</weight></IKMarkerTask>"
TASKS = (
    "<OpenSimDocument Version='40000'><IKTaskSet"
    " name='tasks'><objects>{}</objects></IKTaskSet></OpenSimDocument>"
)


@dataclass(frozen=True, eq=False)
class ByCommand:
    """What a study left of one recording.

    `line`: what the step reports of its tensions; `residuals`: what it reports of those of the
    root; `warnings` of the trial.
    """

    model: mm.Model
    tension: Tension
    wrenches: mm.Wrenches
    line: str
    residuals: str
    warnings: tuple[str, ...]


def write_study(folder: Path, data: Path, contacts: str = "none") -> Path:
    """Write a study file of all recordings in a folder.

    The model and the weights of markers are next to it. Each animal is a subject; the groups are by
    the marks in the files' names, whose meaning is not known. `contacts`: "" for the default, which
    refuses tensions of all of them.
    """
    model = both_hindlimbs(data)
    write_osim(model, folder / "mouse.osim")
    tasks = "".join(TASK.format(name, LOOSE.get(name, 1.0)) for name in model.marker_names)
    (folder / "tasks.xml").write_text(TASKS.format(tasks))
    labels = ", ".join(f'"{old}" = "{new}"' for old, new in GAIT_LABELS.items())
    said = f'contacts = "{contacts}"' if contacts else ""
    recordings = {path.stem.split("_")[1]: path for path in gait_files(data)}
    subjects = [
        SUBJECT.format(name=name, recording=path, steps=[*STEPS], labels=labels, contacts=said)
        for name, path in recordings.items()
    ]
    marked = [name for name in recordings if (name == "none") is False]
    unmarked = [name for name in recordings if (name == "none") is True]
    text = STUDY.format(marked=marked, unmarked=unmarked, subjects="".join(subjects))
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@lru_cache(maxsize=2)
def by_command(data: Path) -> Mapping[str, ByCommand]:
    """Return what one study file gives of every recording, by the name of the animal."""
    found = {}
    with tempfile.TemporaryDirectory() as home:
        out = Path(home) / "out"
        for outcome in run_study(read_plan(write_study(Path(home), data)), out):
            if outcome.error:
                raise RuntimeError(outcome.error)
            if "tension" not in outcome.done:
                continue
            name = outcome.folder.parent.name
            model = mm.read_model(next(outcome.folder.parent.rglob("*.osim")))
            (result,) = mm.load(outcome.folder).values()
            assert result.tension is not None
            assert result.wrenches is not None
            assert result.motion is not None
            assert result.torques is not None
            line = tension_line(model, result.tension)
            residuals = residual_verdict(model, result.motion, result.torques, result.wrenches)
            found[name] = ByCommand(
                model=model,
                tension=result.tension,
                wrenches=result.wrenches,
                line=line,
                residuals=residuals,
                warnings=tuple(outcome.findings),
            )
    return found


@lru_cache(maxsize=2)
def by_default(data: Path) -> Mapping[str, str]:
    """Find what stops the tensions of each recording where nothing is said of contacts.

    Returns
    -------
    error by the name of the animal, "" for none
    """
    with tempfile.TemporaryDirectory() as home:
        study = read_plan(write_study(Path(home), data, contacts=""))
        outcomes = run_study(study, Path(home) / "out")
        return {outcome.folder.parent.name: outcome.error for outcome in outcomes if outcome.trial}
