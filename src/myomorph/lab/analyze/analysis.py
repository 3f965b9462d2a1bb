"""Recordings to results in one call: what the command `analyze` does, as values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

from myomorph.core.io.parsing.cells import plain_cell
from myomorph.core.model.errors import BadData, counted, from_extra
from myomorph.core.model.shown import shown
from myomorph.lab.analyze.analyze import prepare_study
from myomorph.lab.session.read import read_session
from myomorph.lab.session.session import Session
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.summary.study_tables import PAGE, TIDY
from myomorph.lab.study.trial.load import TrialResult, load

if TYPE_CHECKING:
    import pandas

REPORT = "report.html"


class AnalyzeOptions(TypedDict, total=False):
    """Options of `analyze`: those of the command.

    Attributes
    ----------
    mass : of the subject [kg]; without it, plates weigh the subject where they can
    height : of the subject [m], which scales the generic model
    static : recording of standing still; by default found among or beside the recordings
    model : OpenSim or MuJoCo file with markers; by default myo-sim's legs and trunk
    arms : give the generic model both arms, where markers show how they move
    keys : of the inputs of trials, as a study file has them; they go before what is found
    options : of the steps, by step and setting
    """

    mass: float
    height: float
    static: str | Path
    model: str | Path
    arms: bool
    keys: Mapping[str, object]
    options: Mapping[str, Mapping[str, object]]


@shown
@dataclass(frozen=True, eq=False, kw_only=True)
class Analysis:
    """What `analyze` found and wrote.

    Attributes
    ----------
    folder : of the results
    recordings : that were analyzed
    study : the study file, which `run_study` and `myomorph run` take again
    assumed : what was found or assumed, one sentence each
    outcomes : what became of each trial, and of what is done once for a subject
    """

    folder: Path
    recordings: tuple[Path, ...]
    study: Path
    assumed: tuple[str, ...]
    outcomes: tuple[Outcome, ...]

    @property
    def headline(self) -> str:
        """How many trials there are, in one line."""
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"{counted(len(self.trials), 'trial')} in '{self.folder}'{failed}"

    @property
    def failed(self) -> Mapping[str, str]:
        """Why each trial failed that did, by its name."""
        return {
            "/".join(filter(None, outcome.key)): outcome.error
            for outcome in self.outcomes
            if outcome.error
        }

    @cached_property
    def session(self) -> Session:
        """Who was recorded, when, and in which movements."""
        return read_session(self.recordings)

    @cached_property
    def trials(self) -> Mapping[str, TrialResult]:
        """Results of each trial, by subject and trial; read when they are first used."""
        return load(self.folder)

    @property
    def trial(self) -> TrialResult:
        """The only trial; raises `BadData` where there are more."""
        if len(self.trials) != 1:
            raise BadData(
                f"{len(self.trials)} trials: choose one of .trials ({', '.join(self.trials)})"
            )
        return next(iter(self.trials.values()))

    @property
    def reports(self) -> Mapping[str, Path]:
        """Page of each trial, by the trial's name."""
        pages = {name: trial.path.parent / REPORT for name, trial in self.trials.items()}
        return {name: page for name, page in pages.items() if page.is_file()}

    @property
    def page(self) -> Path:
        """Page of all trials."""
        return self.folder / PAGE

    def to_pandas(self) -> pandas.DataFrame:
        """Put all values into one table: subject, trial, step, quantity, value and unit of each.

        Raises
        ------
        MissingPackage : pandas is not installed
        """
        pandas = from_extra("xarray", "pandas")
        table = pandas.read_csv(self.folder / TIDY)
        texts = table.select_dtypes(exclude="number").columns
        for column in texts:
            table[column] = table[column].map(plain_cell, na_action="ignore")
        return table


def analyze(
    recordings: str | Path | Sequence[str | Path],
    out: str | Path = "analysis",
    **options: Unpack[AnalyzeOptions],
) -> Analysis:
    """Go from raw recordings to joint angles, torques, muscle forces and reports.

    Does what `myomorph analyze` does: protocol, axes, static trial, forces, EMG and model are
    found; what is known already is said by options. Results that are there already, from the same
    files and options, are not computed again.

    Parameters
    ----------
    recordings : a file (.c3d, .trc, .mvnx, ...), a folder, or several of them
    out : folder to write, made where it does not exist
    options : `mass`, `height`, `static`, `model`, `arms`, `keys` and `options`, see
        `AnalyzeOptions`

    Returns
    -------
    session, trials with their results, paths of pages and study file

    Raises
    ------
    MyomorphError
        with one line that says what is missing, and the option that supplies it, or why no trial
        could be analyzed

    Examples
    --------
    >>> import myomorph as mm
    >>> walk = mm.sample("walk").write("recordings")
    >>> analysis = mm.analyze(walk.recording, "walk", model=walk.model, mass=70.0)
    >>> analysis.trial.torques.names[:2]
    ('pelvis_tilt', 'pelvis_list')
    """
    given = [recordings] if isinstance(recordings, str | Path) else list(recordings)
    prepared = prepare_study(given, out, **options)
    outcomes = run_study(read_plan(prepared.study), Path(out))
    trials = [outcome for outcome in outcomes if outcome.trial]
    errors = [outcome.error for outcome in trials if outcome.error]
    if trials and len(errors) == len(trials):
        raise BadData(f"no trial could be analyzed: {errors[0]}")
    # Results are read later, maybe from another working folder.
    return Analysis(
        folder=Path(out).absolute(),
        recordings=tuple(Path(path).absolute() for path in given),
        study=prepared.study.absolute(),
        assumed=prepared.assumed,
        outcomes=tuple(outcomes),
    )
