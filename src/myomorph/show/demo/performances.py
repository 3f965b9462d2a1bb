"""[D] chapter 5 as files that a laboratory would have.

They are of two fighters, Tai Chi on one plate, tap dance and a drum. Everything is simulated and
its truth known. Each is markers, raw EMG with unknown gains, contacts and a study file in a folder;
`run` does the rest with default options.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.io.wavfile import write as write_wav

from myomorph.core.io.mjcf.compile import silent_mujoco
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.join import join_models, part_of
from myomorph.core.model.series import Motion, Series, Table
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.show.simulate.bout import GRIPS
from myomorph.show.simulate.drums import RATE, Scene, instruments, record
from myomorph.show.simulate.fighter import PARTS, fighter_text
from myomorph.show.simulate.pair import PairOptions, pair_sites, virtual_pair
from myomorph.show.simulate.performances import (
    DRUM_PLACES,
    STICK_OF,
    STOOL,
    TIP,
    drum_part,
    taichi_part,
    tap_part,
)
from myomorph.show.simulate.performer import MASS, Performance, performed, sole, with_marker_tuple
from myomorph.show.simulate.recorded_files import write_markers, write_plate_c3d, write_raw_emg

ERRORS = "contact_errors.csv"
STROKES = "true_strokes.csv"
CUTOFF = 6.0  # Low-pass of the fighters' true forces and motion [Hz].
UKE_LATER = 0.2  # So much later uke's recording begins [s].
PLATE = np.array([0.06, 0.0, 0.0]), (0.5, 0.7)  # Its middle and size [m].
LONG_PLATE = np.array([0.2, 0.0, 0.0]), (0.9, 0.7)  # Of somebody who steps ahead [m].
CAMERA_RATE = 120.0
CAMERA_START = -0.3  # Of the camera that saw the taps [Hz], and its zero on the motion's clock [s].
SCENE = Scene("two drums", drums=2, interval=0.9, duration=9.0)
DRUM_SEED = 57
SOUND_EARLY = 0.35
"""Of the drums, and how much earlier than the motion the sound begins [s]."""
KNOWN_EVERY = 3  # Every so many strokes of a drum have a known impulse.

HEAD = """
[study]
name = "{name}"
[options.report]
preset = "{name}"
muscles = ["Deltoid, anterior", "Rectus femoris", "Biceps femoris, long head", \
"Tibialis anterior", "glut_med"]
"""
SUBJECT = """
[[subject]]
name = "{name}"
model = "{name}.xml"
mass = {mass}
steps = {steps}
[[subject.trials]]
name = "{trial}"
markers = "{markers}"
emg = "{name}_emg.sto"
true_torques = "{name}_true_torques.sto"
true_activations = "{name}_true_activations.sto"
simulated = ["{simulated}"]
"""
TOGETHER = """
[[together]]
name = "judo"
trials = {tori = "bout", uke = "bout"}
contacts = "grips.toml"
"""
SITE = """
[[site]]
name = "{name}"
body = "{body}"
points = {points}
{more}
"""
SKILL = "skill against it [%]"
SIMULATED = (
    "Everything: {who} moved as planned in MuJoCo; nobody was measured. Muscles run straight: they"
    " are no anatomy. Activations follow another criterion than the estimate, masses are 5 % and"
    " muscles' strengths 15 % off, markers slide on the skin, EMG has gains that nobody knows"
    " (standard deviations)."
)


@dataclass(frozen=True, eq=False)
class Written:
    """A study file in its folder, and what truly happened.

    Attributes
    ----------
    study : the file
    results : folder of the recording in that of the results
    forces : (frames, contacts, 3) in ground [N]
    torques : of hinges [N m]
    activations : of muscles
    strokes : of drums: drum, time [s], impulse [N s] and whether the contact file says it
    """

    study: Path
    results: Path
    forces: Series
    torques: Series
    activations: Series
    strokes: Sequence[tuple[str, float, float, bool]] = ()


def write_performance(name: str, folder: Path) -> Written:
    """Simulate the recording of a demonstration, one of `PERFORMANCES`, and write its files."""
    folder.mkdir(parents=True, exist_ok=True)
    return PERFORMANCES[name](folder)


def contact_rows(written: Written, out: Path) -> Iterator[dict[str, object]]:
    """Yield the norm of the true force and of the estimate's error of each contact.

    They are root mean squares over the frames in which the force was estimated in the results
    `out`. The skill against a constant guess stands beside: the share of the variance about the
    true mean that the estimate explains, below 0 where the mean is nearer.
    """
    table = read_sto(out / written.results / "contact_groups.sto")
    for column, contact in enumerate(written.forces.names):
        true = written.forces.values[:, column]
        estimate = [
            np.interp(
                written.forces.time,
                table.time,
                table[f"{contact}_f{axis}"],
                left=np.nan,
                right=np.nan,
            )
            for axis in "xyz"
        ]
        square = np.nanmean((np.transpose(estimate) - true) ** 2, axis=0)
        constant = true[np.isfinite(estimate[0])].var(axis=0)
        yield {
            "contact": contact,
            "true, RMS [N]": float(np.sqrt(np.mean(np.sum(true**2, axis=1)))),
            "true, SD of vertical [N]": float(true[:, 1].std()),
            "error, RMS [N]": float(np.sqrt(square.sum())),
            "error, vertical [N]": float(np.sqrt(square[1])),
            "error, fore-aft [N]": float(np.sqrt(square[0])),
            "error, lateral [N]": float(np.sqrt(square[2])),
            "a constant guess, RMS [N]": float(np.sqrt(constant.sum())),
            SKILL: skill(square.sum(), constant.sum()),
            "skill, vertical [%]": skill(square[1], constant[1]),
        }


def skill(square: float, constant: float) -> float:
    """Return the share of a constant guess's mean square that an estimate leaves out [%].

    Parameters
    ----------
    square : mean square error of the estimate
    constant : that of the best constant, the variance; NaN comes of 0

    Examples
    --------
    >>> skill(square=25.0, constant=100.0)
    75.0
    """
    return 100.0 * (1.0 - float(square) / float(constant)) if constant > 0.0 else float("nan")


def write_errors(written: Written, out: Path, path: Path) -> str:
    """Write `contact_rows`, and say the skill of each contact in a line."""
    rows = [
        {name: value if isinstance(value, str) else f"{value:.1f}" for name, value in row.items()}
        for row in contact_rows(written, out)
    ]
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    return ", ".join(f"{row['contact']} {row[SKILL]} %" for row in rows)


def _judo(folder: Path) -> Written:
    """Write markers and raw EMG of each fighter, and grips that may pass force any way."""
    pair = virtual_pair(PairOptions("sway", 1), CUTOFF)
    truth = pair.truth
    torques = inverse_dynamics(
        join_models(truth.models), differentiate(truth.motion, CUTOFF), truth.wrenches
    )
    hinges = [index for index, name in enumerate(torques.names) if "_pelvis_" not in name]
    of_hinges = Series(
        torques.time, tuple(torques.names[index] for index in hinges), torques.values[:, hinges]
    )
    texts = []
    for seed, part in enumerate(PARTS, 61):
        text = with_marker_tuple(fighter_text(part, pair.builds[part]))
        with silent_mujoco():
            model = model_from_mujoco(
                mujoco.MjModel.from_xml_string(text), marker_sites="marker_.*"
            )
        moved = part_of(truth.motion, part)
        late = moved.time >= (UKE_LATER if part == "uke" else 0.0)
        motion = Motion(moved.time[late], moved.names, moved.values[late])
        write_markers(model, motion, folder / f"{part}.trc", seed)
        activations = part_of(truth.activations, part)
        _write_person(folder, part, text, part_of(of_hinges, part), activations, seed + 2)
        texts.append(
            _subject(part, model.mass, ["calibrate", "ik"], "bout", f"{part}.trc", "two fighters")
        )
    grips = [
        _site(
            site.name,
            site.body,
            site.points,
            f'against = "{site.against}"\ndirection = "any"\nintervals = "always"',
        )
        for site in pair_sites(pair.builds)
        if site.name in GRIPS
    ]
    (folder / "grips.toml").write_text("".join(grips), encoding="utf-8")
    study = _study(folder, "judo", [*texts, TOGETHER])
    return Written(
        study=study,
        results=Path("judo"),
        forces=truth.forces,
        torques=torques,
        activations=truth.activations,
    )


def _taichi(folder: Path) -> Written:
    """Two feet on one plate that share its force."""
    shown = performed(taichi_part())
    write_plate_c3d(shown, folder / "taichi.c3d", *LONG_PLATE, 53)
    more = 'contacts = "auto"\noptions = {tension = {measured = "shared"}}'
    return _alone(folder, shown, "taichi", "taichi.c3d", 52, more)


def _tap(folder: Path) -> Written:
    """Four contacts, one plate, a camera that saw when each end of a foot bears load."""
    shown = performed(tap_part())
    write_plate_c3d(shown, folder / "tap.c3d", *PLATE, 56)
    lines = ["site,first_frame,last_frame"]
    for column, name in enumerate(shown.forces.names):
        for first, stop in runs(shown.forces.values[:, column, 1] > 5.0):
            frames = (
                ((shown.forces.time[[first, stop - 1]] - CAMERA_START) * CAMERA_RATE)
                .round()
                .astype(int)
            )
            lines.append(f"{name},{frames[0]},{frames[1]}")
    (folder / "touches.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    head = (
        'feet = false\nmeasured = "shared"\nintervals = "touches.csv"\n[camera]\nrate ='
        f" {CAMERA_RATE}\n"
    )
    sites = [
        _site(f"{end}_{side}", f"foot_{side}", sole(side, end), 'intervals = "file"')
        for side in "rl"
        for end in ("heel", "toe")
    ]
    (folder / "contacts.toml").write_text(
        f"{head}start = {CAMERA_START}\n{''.join(sites)}", encoding="utf-8"
    )
    return _alone(folder, shown, "tap", "tap.c3d", 55, 'contacts = "contacts.toml"')


def _drum(folder: Path) -> Written:
    """Two drums, two microphones; of some strokes the impulse is known, to calibrate by."""
    sound, heard = record(SCENE, DRUM_SEED)
    begins = SOUND_EARLY + 0.4
    strokes = [
        (stroke.drum, stroke.time - SOUND_EARLY, stroke.impulse)
        for stroke in heard
        if stroke.time > begins
    ]
    shown = performed(drum_part(strokes, SCENE.duration - begins))
    write_markers(shown.body, shown.motion, folder / "drum.trc", 60)
    write_wav(folder / "drum.wav", int(RATE), (32767 * sound.samples).astype(np.int16))
    lines = ['[sound]\nfile = "drum.wav"\nstart = "auto"\nimpulse = "known"\n']
    known = [
        stroke
        for name in DRUM_PLACES
        for stroke in [s for s in strokes if s[0] == name][::KNOWN_EVERY]
    ]
    for instrument in instruments(SCENE):
        pairs = [
            [round(at, 3), round(impulse, 3)]
            for name, at, impulse in known
            if name == instrument.name
        ]
        lines.append(
            f'[[instrument]]\nname = "{instrument.name}"\nchannel ='
            f' "{instrument.channel}"\ndistance = {instrument.distance}\nsites ='
            f' ["stick_{STICK_OF[instrument.name]}"]\nknown = {pairs}\n'
        )
    lines += [
        _site(f"stick_{side}", f"forearm_{side}", TIP[None], 'intervals = "file"') for side in "rl"
    ]
    lines.append(_site("stool", "pelvis", STOOL, 'intervals = "always"'))
    (folder / "contacts.toml").write_text("".join(lines), encoding="utf-8")
    listed = [(*stroke, stroke in known) for stroke in strokes]
    with (folder / STROKES).open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows(
            [("drum", "time [s]", "impulse [N s]", "in contacts.toml"), *listed]
        )
    return _alone(folder, shown, "drum", "drum.trc", 59, 'contacts = "contacts.toml"', listed)


PERFORMANCES: Mapping[str, Callable[[Path], Written]] = {
    "judo": _judo,
    "taichi": _taichi,
    "tap": _tap,
    "drum": _drum,
}


def _alone(
    folder: Path,
    shown: Performance,
    name: str,
    markers: str,
    seed: int,
    more: str,
    strokes: Sequence[tuple[str, float, float, bool]] = (),
) -> Written:
    """Model, EMG, truth and study file of a single performer."""
    _write_person(folder, "performer", shown.text, shown.torques, shown.activations, seed)
    steps = ["calibrate", "ik", "id", "muscles", "tension", "report"]
    study = _study(
        folder, name, [_subject("performer", MASS, steps, name, markers, "a person"), more, "\n"]
    )
    return Written(
        study=study,
        results=Path("performer", name),
        forces=shown.forces,
        torques=shown.torques,
        activations=shown.activations,
        strokes=strokes,
    )


def _write_person(
    folder: Path, name: str, text: str, torques: Series, activations: Series, seed: int
) -> None:
    """Model, raw EMG and truth of one person."""
    (folder / f"{name}.xml").write_text(text, encoding="utf-8")
    write_raw_emg(activations, folder / f"{name}_emg.sto", seed)
    for what, series in (("torques", torques), ("activations", activations)):
        write_sto(
            Table(series.time, series.names, series.values), folder / f"{name}_true_{what}.sto"
        )


def _subject(
    name: str, mass: float, steps: Sequence[str], trial: str, markers: str, who: str
) -> str:
    simulated = SIMULATED.format(who=who)
    mass = round(mass, 1)
    return SUBJECT.format(
        name=name, mass=mass, steps=list(steps), trial=trial, markers=markers, simulated=simulated
    )


def _site(name: str, body: str, points: Array, more: str) -> str:
    return SITE.format(name=name, body=body, points=np.asarray(points, float).tolist(), more=more)


def _study(folder: Path, name: str, texts: Sequence[str]) -> Path:
    path = folder / "study.toml"
    path.write_text("".join([HEAD.format(name=name), *texts]), encoding="utf-8")
    return path
