"""The demo of forces that nobody measured: those between two simulated fighters, found, and laid beside the truth."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from myomorph.contact.plan import ContactPlan
from myomorph.model.arrays import runs
from myomorph.model.contacts import ContactForces, Contacts, Touch
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.series import Emg, Series, Trial
from myomorph.motion.filters import differentiate
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.simulate.bout import FEET, GRIPS
from myomorph.simulate.pair import CHANNELS, PairOptions, PairTruth, VirtualPair, pair_sites, virtual_pair
from myomorph.store.contact_store import get_contact_forces
from myomorph.store.outcome import Outcome
from myomorph.store.results import STORED, file_name, read_result, value_source
from myomorph.store.settings import Differentiation, ReportOptions
from myomorph.study.inputs.emg import RecordedEmg
from myomorph.study.inputs.input import ByType, OptionSet
from myomorph.study.inputs.loads import ExternalLoads
from myomorph.study.inputs.markers import Recording
from myomorph.study.inputs.mass import BodyMass
from myomorph.study.step.step import large_variables
from myomorph.study.step.step_table import usual_steps
from myomorph.study.trial.run_trial import run_trial
from myomorph.study.trial.trial_inputs import KnownTruth, TrialInputs, TrialNotes
from myomorph.tension.emg_targets import EmgOptions
from myomorph.tension.tension import TensionOptions

CUTOFF = 6.0  # Low-pass of motion and of the true forces [Hz].
BOUT = PairOptions("sway", 1)
ERRORS = "contact_errors.csv"


def run_judo_demo(out: Path) -> Outcome:
    """Simulate a bout, run the whole chain on it into a folder, and write `ERRORS` beside its tables and report."""
    pair = virtual_pair(BOUT, CUTOFF)
    trial = judo_trial(pair)
    outcome = run_trial(trial, usual_steps(), out, fresh=True)
    if not outcome.error:
        contact_forces = get_contact_forces(
            read_result(out / f"{file_name(trial.name)}{STORED}", leave_out=large_variables())
        )
        assert contact_forces is not None
        write_errors(contact_forces, pair.truth, out / ERRORS)
    return outcome


def judo_trial(pair: VirtualPair) -> TrialInputs:
    """A bout as the steps take it: markers, 16 channels of EMG a fighter, touches; true forces are only compared."""
    sites = pair_sites(pair.builds, directed=True)
    channels = tuple(name for name in pair.emg.names if name.split("_", 1)[1].startswith(CHANNELS))
    emg = Emg(pair.emg.time, channels, np.array([pair.emg[name] for name in channels]).T)
    model, truth = pair.model, pair.truth
    return TrialInputs(
        name=f"{pair.options.kind} {pair.options.seed}",
        subject="tori and uke",
        model=model,
        inputs=ByType(
            Recording(Trial(pair.markers)),
            ExternalLoads(lambda motion: truth.wrenches),
            RecordedEmg(emg, FrozenMap({name: (name,) for name in channels})),
            ContactPlan(
                feet=False,
                sites=sites,
                when=FrozenMap({site.name: "file" for site in sites}),
                reported=touches_of(pair.touching),
                measured="hidden",
            ),
            BodyMass(model.mass),
            KnownTruth(FrozenMap(known_of(truth, pair))),
        ),
        options=OptionSet(
            EmgOptions(delay=0.0, gains="normalized"),
            # MuJoCo's muscles have passive force, and no tendon that could take up their stretch.
            TensionOptions(passive=True),
            Differentiation(CUTOFF),
            ReportOptions(preset="judo"),
        ),
        notes=TrialNotes(simulated=simulated_of(pair)),
        sources=(
            value_source("model", "demo:judo", *(np.append(body.mass_center, body.mass) for body in model.bodies)),
            value_source("markers", "simulated markers", pair.markers.values),
            value_source("EMG", "simulated EMG", emg.values),
            value_source("contacts", "contact states of the simulation", pair.touching.values),
        ),
    )


def simulated_of(pair: VirtualPair) -> tuple[str, ...]:
    """What is simulated, and how badly it is measured."""
    options = pair.options
    tori, uke = (model.mass for model in pair.models.values())
    return (
        f"Everything: two bodies of {tori:.0f} and {uke:.0f} kg with {len(pair.emg.names) // 2} muscles each, moved "
        "forward by MuJoCo under the forces of their muscles; nobody was measured. Muscles run straight: they are no "
        "anatomy.",
        "The fighters choose activations by another criterion than the estimate: weighted cubes above a random tone, "
        "and a pull that is intended.",
        f"Markers have {1000 * options.marker_noise:g} mm of white noise, muscles' strengths are off by "
        f"{100 * options.strength_error:.0f} %, gains of EMG by {100 * options.emg_gain:.0f} % (standard deviations); "
        f"seed {options.seed}.",
        "Contact forces called measured are the true ones; the estimate has not seen them. It knows which foot stands "
        "and about where the grips pull to.",
    )


def known_of(truth: PairTruth, pair: VirtualPair) -> dict[str, Series]:
    """The truth as the report takes it."""
    return {
        "motion": truth.motion,
        "torques": inverse_dynamics(pair.model, differentiate(truth.motion, CUTOFF), truth.wrenches),
        "activations": truth.activations,
    }


def touches_of(states: Series) -> Contacts:
    """Spans in which each site touches."""
    touches = []
    for name, column in zip(states.names, states.values.T, strict=True):
        for first, last in runs(column > 0.5):
            touches.append(Touch(name, float(states.time[first]), float(states.time[last - 1]), source="simulation"))
    return Contacts(states.names, tuple(touches))


def write_errors(contact_forces: ContactForces, truth: PairTruth, path: Path) -> None:
    """Write the size of each foot's and grip's true force and of the estimate's error, root mean squares [N]."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(("contact", "true force [N]", "error [N]", "error x", "error y", "error z"))
        for name in (*FEET, *GRIPS):
            columns = [index for index, site in enumerate(contact_forces.sites) if site.group == name]
            miss = contact_forces.forces[:, columns].sum(axis=1) - truth.forces[name]
            along = np.sqrt(np.mean(miss**2, axis=0))
            size = np.sqrt(np.mean(np.sum(truth.forces[name] ** 2, axis=1)))
            table.writerow((name, *(f"{number:.1f}" for number in (size, np.linalg.norm(along), *along))))
