"""`simulate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.forward.changes import NO_CHANGES, Changes
from myomorph.forward.folder import (
    CHANGED,
    STEP,
    UNCHANGED,
    sentence_of,
    write_page,
    write_run,
)
from myomorph.forward.inputs import SimulationFiles, SimulationInputs, read_inputs
from myomorph.forward.page_run import PageRun, page_run
from myomorph.forward.shares import shares_of
from myomorph.forward.simulate import SimulationOptions, simulate
from myomorph.forward.simulation import Simulation
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import said, warn
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_source, provenance_of, whole_folder
from myomorph.lab.store.settings import with_settings
from myomorph.lab.study.inputs.reading import has_mass, open_model

SimulationSettings = flags.options_class(SimulationOptions)
MAX_NAMED = 3


@flags.documented
@dataclass(frozen=True, kw_only=True)
class CaseFlags:
    """Files of a simulation, and what if.

    Attributes
    ----------
    start : motion (.mot, .sto) whose first frame is the initial state; by default the model's
        default pose at rest
    activations : muscle activations over time (.sto), as 'myomorph tension' writes them; without
        them and without torques muscles are at rest
    excitations : muscle excitations over time (.sto), which activations follow
    torques : joint torques over time (.sto), as 'myomorph id' writes them, which replace muscles
        and passive tissue
    reserves : forces of reserve and residual actuators over time (.sto), as 'myomorph tension'
        writes them, in addition to --activations
    loads : external forces of the motion
    contacts : auto for compliant spheres under the feet that touch a floor, or none
    floor : height of the floor [m]
    time : START END [s]: part of the motion that is used
    cutoff : cutoff frequency of the low-pass filter of the motion and the external forces [Hz], the
        one with which the torques were computed; 0 for none
    follow : natural frequency of a feedback that makes the body follow the motion [Hz]; its forces
        are reported; 0 for none
    weaker : MUSCLE=FACTOR ...: factors of muscle strength, for example soleus_r=0.5
    mass : BODY=FACTOR ...: factors of the mass of bodies, for example torso=1.2
    viscosity : factor of all damping of joints, bushings and muscles
    """

    start: Path | None = None
    activations: Path | None = None
    excitations: Path | None = None
    torques: Path | None = None
    reserves: Path | None = None
    loads: Path | None = None
    contacts: Literal["none", "auto"] = "none"
    floor: float = 0.0
    time: tuple[float, float] | None = None
    cutoff: float = 0.0
    follow: float = 0.0
    weaker: tuple[str, ...] = ()
    mass: tuple[str, ...] = ()
    viscosity: float = 1.0

    @property
    def changes(self) -> Changes:
        """What if; raises `BadData`."""
        return Changes(
            strength=_factors("--weaker", self.weaker, "MUSCLE=FACTOR, as soleus_r=0.5"),
            mass=_factors("--mass", self.mass, "BODY=FACTOR, as torso=1.2"),
            viscosity=self.viscosity,
        )

    @property
    def files(self) -> SimulationFiles:
        """The files, as what reads them takes them."""
        return SimulationFiles(
            start=self.start,
            activations=self.activations,
            excitations=self.excitations,
            torques=self.torques,
            reserves=self.reserves,
            loads=self.loads,
            time=self.time,
            cutoff=self.cutoff,
            follow=self.follow,
            contacts=self.contacts,
            floor=self.floor,
        )


CaseOptions = Annotated[CaseFlags, Parameter(name="*")]
NO_FILES = CaseFlags()


@flags.documented
def simulate_command(
    *,
    model: flags.ModelFile,
    out: flags.OutFolder,
    case: CaseOptions = NO_FILES,
    options: SimulationSettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Forward dynamics: how a body moves under its muscles, torques and passive forces.

    With --weaker, --mass or --viscosity it moves twice, as it is and changed, and both are shown
    side by side.
    """
    flags.use_threads(threads)
    changes = case.changes
    named = case.files
    settings = with_settings(SimulationOptions(), flags.settings_dict(options))
    read = open_model(model)
    has_mass(read, "a simulation")
    other = changes.applied(read) if changes else None
    inputs = read_inputs(named, read)
    if settings.passive is None:
        settings = replace(settings, passive=inputs.passive)
    made = provenance_of(
        STEP,
        (file_source("model", model), *named.sources),
        {**flags.settings_dict(options), "changes": changes.to_json()},
    )
    first = _run(UNCHANGED if changes else "simulation", read, inputs, settings)
    runs = [first]
    if other is not None:
        runs.append(_run(CHANGED, other, inputs, settings))
    with whole_folder(out) as folder:
        for run in runs:
            home = folder / run.page.shown.name if changes else folder
            home.mkdir(exist_ok=True)
            of_run = changes if run is not first else NO_CHANGES
            write_run(run.page, home, made, of_run)
        pages = [run.page for run in runs]
        write_page(folder, read.name, pages, made, sentence_of(changes))
    notes: list[Message] = [*read.warnings, *inputs.notes]
    for run in runs:
        notes += run.page.notes
    warn(dict.fromkeys(notes))
    _say(runs, inputs, out)
    return 0


@dataclass(frozen=True, eq=False, kw_only=True)
class _Done:
    """A simulation with what its page shows."""

    simulation: Simulation
    page: PageRun


def _run(name: str, model: Model, inputs: SimulationInputs, options: SimulationOptions) -> _Done:
    """Simulate, with a bar of progress."""
    frames = options.frames_of(inputs.start, inputs.drives)
    with progress(
        f"simulating {name}" if name != "simulation" else "simulating", frames
    ) as advance:
        done = simulate(model, inputs.start, inputs.drives, options, progress=advance)
    return _Done(simulation=done, page=page_run(name, done, _driven(done, inputs, options)))


def _driven(
    done: Simulation, inputs: SimulationInputs, options: SimulationOptions
) -> tuple[tuple[str, str], ...]:
    """Facts on shares of what moved the body, and on a motion that was followed."""
    drives = inputs.drives
    facts = []
    if drives.follow is not None or drives.reserves is not None:
        facts = [(f"{share.where}, RMS", share.sentence) for share in shares_of(done, drives)]
    if options.passive is False:
        text = "none, as in the tensions (else --passive)" if inputs.passive is False else "none"
        facts.append(("Passive forces of muscles", text))
    return (*facts, *_following(done, inputs))


def _following(done: Simulation, inputs: SimulationInputs) -> tuple[tuple[str, str], ...]:
    """Facts on a motion that was followed."""
    followed = inputs.drives.follow
    if followed is None:
        return ()
    apart = {"": 0.0}
    for column, name in enumerate(done.motion.names):
        if name in done.free and name in followed.names:
            wanted = np.interp(done.time, followed.time, followed[name])
            apart[name] = float(np.abs(done.motion.values[:, column] - wanted).max())
    farthest = sorted(apart, key=lambda name: -apart[name])[:MAX_NAMED]
    size = float(np.sqrt(np.mean(done.feedback**2)))
    facts = [
        (
            "Feedback",
            f"{inputs.drives.feedback:g} Hz, RMS {size:.3g} N m or N over all coordinates",
        ),
        (
            "Distance from the motion, at most",
            ", ".join(f"{name} {apart[name]:.2g} rad or m" for name in farthest if name),
        ),
    ]
    torques = inputs.drives.torques
    if torques is not None:
        shares = done.feedback_share(torques)
        worst = sorted(shares, key=lambda name: -shares[name])[:MAX_NAMED]
        text = ", ".join(f"{name} {100 * shares[name]:.2g} %" for name in worst)
        facts.append(("Feedback by torque, RMS", text))
    return tuple(facts)


def _factors(flag: str, texts: Sequence[str], expected: str) -> FrozenMap[str, float]:
    factors = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            factors[name] = float(number)
        except ValueError:
            raise BadData(f"{flag} {text}: expected {expected}") from None
    return FrozenMap(factors)


def _say(runs: Sequence[_Done], inputs: SimulationInputs, out: Path) -> None:
    """Print what was simulated, and where it is."""
    for run in runs:
        done = run.simulation
        seconds = float(done.time[-1] - done.time[0])
        name = f"{run.page.shown.name}: " if len(runs) > 1 else ""
        said(
            f"{name}{seconds:g} s in {done.counts.steps} steps; energy error"
            f" {100 * done.energy.largest_share:.2g} %"
        )
        for fact, text in run.page.facts[3:]:
            said(f"  {fact}: {text}")
    if len(runs) > 1:
        difference = _difference(*(run.simulation for run in runs))
        said(f"  {difference}")
    said(f"report: {(out / 'report.html').resolve()}")


def _difference(first: Simulation, second: Simulation) -> str:
    """Say which coordinates differ most at the end."""
    apart = second.motion.values[-1] - first.motion.values[-1]
    order = np.argsort(-np.abs(apart))[:MAX_NAMED]
    kinds = first.model.motion_kinds
    parts = []
    for column in order:
        name = first.motion.names[column]
        turns = kinds[name] == "rotational"
        value = np.degrees(apart[column]) if turns else apart[column]
        unit = "deg" if turns else "m"
        parts.append(f"{name} {value:+.3g} {unit}")
    return f"changed minus unchanged at the end: {', '.join(parts)}"
