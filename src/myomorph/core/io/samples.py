"""Small recordings by name: simulated, or brought by a package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

from myomorph.core.io.loads import write_external_loads
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, check_extra, quoted
from myomorph.core.model.extension import load
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.movement import Movement
from myomorph.core.model.registry import with_extensions
from myomorph.core.model.series import Emg, Event, Markers, Series, Trial, Wrenches
from myomorph.core.model.shown import picture_of, shown

SAMPLES = with_extensions({}, "sample", lambda extension: extension.samples)


@shown
@dataclass(frozen=True, kw_only=True)
class SampleSource:
    """Where a sample comes from.

    Attributes
    ----------
    kind : whether somebody was recorded, or all of it is simulated
    text : what it is, in a sentence or two
    licence : of what it is made from
    citation : whom to name
    """

    kind: Literal["recorded", "simulated"]
    text: str
    licence: str
    citation: str

    @property
    def headline(self) -> str:
        """Kind and text, in one line."""
        return f"{self.kind}: {self.text}"


@dataclass(frozen=True, kw_only=True)
class SampleFiles:
    """Files of a sample.

    Attributes
    ----------
    folder : that holds them
    model : OpenSim model
    recording : markers, as TRC
    loads : external loads, None where the sample has none
    """

    folder: Path
    model: Path
    recording: Path
    loads: Path | None


@shown
@dataclass(frozen=True, eq=False, kw_only=True)
class Sample:
    """A small recording with all that is needed to work with it.

    Attributes
    ----------
    name : of the sample
    model : of the body, with the recording's markers
    recording : markers, EMG and events, as far as it has them
    mass : of the body [kg]
    source : whether it is recorded or simulated, its licence, and whom to name
    movement : "" where none of the words fits
    loads : forces on the feet or on what carries the body, None where there are none
    marker_weights : for inverse kinematics, where they are not alike
    window : part that is worth using [s]
    cutoff : low-pass of motion and forces [Hz]
    truth : true coordinates of a simulation and what else is known, by their names in result files
    """

    name: str
    model: Model
    recording: Trial
    mass: float
    source: SampleSource
    movement: Movement | Literal[""] = ""
    loads: Wrenches | None = None
    marker_weights: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    window: tuple[float, float]
    cutoff: float
    truth: Mapping[str, Series] = field(default_factory=lambda: FrozenMap({}))

    @property
    def headline(self) -> str:
        """What it is, in one line, which says whether it is simulated."""
        start, stop = self.window
        forces = "no forces" if self.loads is None else "forces"
        return f"'{self.name}', {self.source.kind}: {stop - start:.3g} s of markers, {forces}"

    @property
    def markers(self) -> Markers:
        """Markers of the recording."""
        if self.recording.markers is None:
            raise BadData(f"sample '{self.name}' has no markers")
        return self.recording.markers

    @property
    def emg(self) -> Emg | None:
        """EMG of the recording, None where it has none."""
        return self.recording.emg

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of the recording: of a simulation those that are true."""
        return self.recording.events

    def drawing(self) -> str:
        """Draw the model, as HTML for notebooks."""
        return picture_of(self.model)

    def write(self, folder: str | Path, name: str = "") -> SampleFiles:
        """Write model, markers and loads into a folder, under names that say what is simulated.

        Parameters
        ----------
        folder : made where it does not exist; files of the same names are replaced
        name : that the files begin with, "" for kind and name of the sample

        Raises
        ------
        OSError : a file cannot be written
        """
        home = Path(folder)
        home.mkdir(parents=True, exist_ok=True)
        stem = name or f"{self.source.kind}_{self.name}"
        files = SampleFiles(
            folder=home,
            model=home / f"{stem}_model.osim",
            recording=home / f"{stem}.trc",
            loads=None if self.loads is None else home / f"{stem}_grf.xml",
        )
        write_osim(self.model, files.model)
        write_trc(self.markers, files.recording)
        if self.loads is not None and files.loads is not None:
            title = f"{self.source.kind} forces"
            write_external_loads(self.loads, files.loads.with_suffix(".mot"), files.loads, title)
        return files


def sample(name: str, number: int = 1) -> Sample:
    """Return a small recording by its name, which takes a second or two and no network.

    Its `source` says whether somebody was recorded or all of it is simulated, under which licence
    it comes, and whom to name.

    Parameters
    ----------
    name : "walk", "run", "squat", "jump", "mouse" or "swings"
    number : of a recording among those of its name: simulated ones differ in steps and noise

    Returns
    -------
    model, recording, forces where there are any, mass [kg], and source

    Raises
    ------
    BadData : there is no such sample, or no other recording of it
    MissingPackage : what brings the sample is not installed; it says how to install it

    Examples
    --------
    >>> import myomorph as mm
    >>> walk = mm.sample("walk")
    >>> walk.source.kind, walk.movement, round(walk.mass)
    ('simulated', 'walking', 70)
    >>> len(walk.markers.names), walk.loads.bodies
    (26, ('calcn_r', 'calcn_l'))
    """
    if name not in SAMPLES:
        there = quoted(sorted(SAMPLES), most=len(SAMPLES))
        raise BadData(f"unknown sample '{name}': there are {there}")
    for module, package in SAMPLES[name].needs.items():
        check_extra(SAMPLES[name].extra, module, package)
    if number != 1 and not SAMPLES[name].repeats:
        raise BadData(f"sample '{name}' has no recording {number}: there is one")
    return _made(name, number)


@cache
def _made(name: str, number: int) -> Sample:
    make = load(SAMPLES[name].make)
    made: Sample = make(number) if SAMPLES[name].repeats else make()
    return made
