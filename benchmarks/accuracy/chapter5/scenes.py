"""Tai Chi on one plate, tap dance with fewer plates than contacts, a drum with two microphones: simulated, with truth.

Each is files and a study file in a folder; `myomorph run` does the rest with default options.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from scipy.io.wavfile import write as write_wav

import myomorph as mm
from benchmarks.accuracy.chapter5.results import at_times, compared, ran
from benchmarks.errors import rms
from myomorph.io.contact_events import read_events
from myomorph.io.loads import read_external_loads
from myomorph.model.arrays import Array
from truths.laboratory_files import write_markers, write_plate_c3d, write_raw_emg
from truths.performances import DRUM_PLACES, STICK_OF, TIP, drum_part, taichi_part, tap_part
from truths.performer import MASS, Part, Performance, performed, sole
from truths.simulated_drums import RATE, Scene, instruments, record

Row = dict[str, object]
STUDY = """
[study]
name = "{name}"
[[subject]]
name = "performer"
model = "performer.xml"
mass = {mass}
trials = [{{name = "{name}", markers = "{markers}", emg = "emg.sto"{more}}}]
steps = ["calibrate", "ik", "id", "muscles", "tension", "report"]
[options.report]
preset = "{name}"
muscles = ["Deltoid, anterior", "Rectus femoris", "Biceps femoris, long head", "Tibialis anterior", "glut_med"]
"""
SITE = """
[[site]]
name = "{name}"
body = "{body}"
points = {points}
{more}
"""


def prepared(part: Part, seed: int) -> tuple[Performance, Path]:
    """The performance, and a folder with the model and raw EMG of it."""
    shown, folder = performed(part), Path(tempfile.mkdtemp(prefix="chapter5_"))
    (folder / "performer.xml").write_text(shown.text)
    write_raw_emg(shown.activations, folder / "emg.sto", seed)
    return shown, folder


def run(folder: Path, name: str, markers: str, more: str = "") -> Path:
    """Write the study file, run it, and return the folder of the trial's results."""
    study = folder / "study.toml"
    study.write_text(STUDY.format(name=name, mass=MASS, markers=markers, more=f", {more}" if more else ""))
    return ran(study) / "performer" / name


def force_rows(home: Path, shown: Performance) -> Iterator[Row]:
    """Truth and error of each contact's force; torques and activations once."""
    table, rest = (
        mm.read_sto(home / "contact_groups.sto"),
        compared(home, shown.torques, shown.torques.names, shown.activations),
    )
    for k, contact in enumerate(shown.forces.names):
        columns = [f"{contact}_f{axis}" for axis in "xyz"]
        found = np.stack([at_times(table, column, shown.forces.time) for column in columns], axis=1)
        true = shown.forces.values[:, k]
        miss = found - true
        row: Row = {"contact": contact, "true, mean of vertical [N]": float(true[:, 1].mean())}
        row["true, SD of vertical [N]"] = float(true[:, 1].std())
        for axis, column in (("vertical", 1), ("fore-aft", 0), ("lateral", 2)):
            row[f"{axis}, RMS error [N]"] = float(np.sqrt(np.nanmean(miss[:, column] ** 2)))
        yield row | (rest if k == 0 else {})


@cache
def taichi() -> tuple[Performance, Path]:
    """Two feet on one plate that share its force."""
    shown, folder = prepared(taichi_part(), 52)
    write_plate_c3d(shown, folder / "form.c3d", np.array([0.06, 0.0, 0.0]), (0.5, 0.7), 53)
    more = 'contacts = "auto", options = {tension = {measured = "shared"}}'
    return shown, run(folder, "taichi", "form.c3d", more)


def measure_taichi() -> Iterator[Row]:
    """Each foot's force where one plate measured both together."""
    shown, home = taichi()
    yield from force_rows(home, shown)


CAMERA_RATE, CAMERA_START = 120.0, -0.3  # Of the camera that saw the taps [Hz], and its zero on the motion's clock [s].


def camera_table(shown: Performance) -> str:
    """When each end of a foot bears load, in the camera's frames."""
    lines = ["site,first_frame,last_frame"]
    for k, name in enumerate(shown.forces.names):
        on = np.concatenate([[False], shown.forces.values[:, k, 1] > 5.0, [False]])
        edges = np.flatnonzero(np.diff(on.astype(int)))
        for first, last in edges.reshape(-1, 2):
            frames = ((shown.forces.time[[first, last - 1]] - CAMERA_START) * CAMERA_RATE).round().astype(int)
            lines.append(f"{name},{frames[0]},{frames[1]}")
    return "\n".join(lines) + "\n"


def site(name: str, body: str, points: Array, more: str = "") -> str:
    """A site of a contact file."""
    return SITE.format(name=name, body=body, points=[[float(x) for x in point] for point in points], more=more)


@cache
def tap() -> tuple[Performance, Path]:
    """Four contacts, one plate, a camera that saw the touches."""
    shown, folder = prepared(tap_part(), 55)
    write_plate_c3d(shown, folder / "steps.c3d", np.array([0.06, 0.0, 0.0]), (0.5, 0.7), 56)
    (folder / "touches.csv").write_text(camera_table(shown))
    head = f'feet = false\nmeasured = "shared"\nintervals = "touches.csv"\n[camera]\nrate = {CAMERA_RATE}\n'
    sites = [
        site(f"{end}_{side}", f"foot_{side}", sole(side, end), 'intervals = "file"')
        for side in "rl"
        for end in ("heel", "toe")
    ]
    (folder / "contacts.toml").write_text(f"{head}start = {CAMERA_START}\n" + "".join(sites))
    return shown, run(folder, "tap", "steps.c3d", 'contacts = "contacts.toml"')


def measure_tap() -> Iterator[Row]:
    """The force of each end of each foot."""
    shown, home = tap()
    yield from force_rows(home, shown)


SCENE = Scene("two drums", drums=2, interval=0.9, duration=9.0)
DRUM_SEED, SOUND_EARLY = 57, 0.35  # The sound begins earlier than the motion [s].
KNOWN_EVERY = 3  # Every so many strokes of a drum have a known impulse.


@cache
def drum() -> tuple[Performance, Path, list[tuple[str, float, float]], list[tuple[str, float, float]]]:
    """Two drums, two microphones; truth, what was run, all strokes and those that calibrate."""
    sound, heard = record(SCENE, DRUM_SEED)
    strokes = [(one.drum, one.time - SOUND_EARLY, one.impulse) for one in heard if one.time > SOUND_EARLY + 0.4]
    known = [stroke for name in DRUM_PLACES for stroke in [s for s in strokes if s[0] == name][::KNOWN_EVERY]]
    shown, folder = prepared(drum_part(strokes, SCENE.duration - SOUND_EARLY - 0.4), 59)
    write_markers(shown.body, shown.motion, folder / "drum.trc", 60)
    write_wav(folder / "drum.wav", int(RATE), (32767 * sound.samples).astype(np.int16))
    lines = ['[sound]\nfile = "drum.wav"\nstart = "auto"\nimpulse = "known"\n']
    for instrument in instruments(SCENE):
        pairs = [[round(at, 3), round(impulse, 3)] for name, at, impulse in known if name == instrument.name]
        stick = f"stick_{STICK_OF[instrument.name]}"
        lines.append(
            f'[[instrument]]\nname = "{instrument.name}"\nchannel = "{instrument.channel}"\n'
            f'distance = {instrument.distance}\nsites = ["{stick}"]\nknown = {pairs}\n'
        )
    lines += [site(f"stick_{side}", f"forearm_{side}", TIP[None], 'intervals = "file"') for side in "rl"]
    (folder / "contacts.toml").write_text("".join(lines))
    return shown, run(folder, "drum", "drum.trc", 'contacts = "contacts.toml"'), strokes, known


def measure_drum() -> Iterator[Row]:
    """Strokes, their times and impulses as they reach the forearm; torques; feet without plates."""
    shown, home, strokes, known = drum()
    touches = [one for one in read_events(home / "contacts.csv").intervals if one.site.startswith("stick")]
    loads = read_external_loads(home / "contact_forces.xml")
    for name, side in STICK_OF.items():
        on = loads.bodies.index(f"forearm_{side}")
        mine = [stroke for stroke in strokes if stroke[0] == name]
        late, share = [], []
        for _, at, impulse in mine:
            near = [one.start - at for one in touches if one.site == f"stick_{side}" and abs(one.start - at) < 0.05]
            if near:
                late.append(min(near, key=abs))
                span = np.abs(loads.time - at) < 0.2
                found = np.trapezoid(loads.forces[span, on, 1], loads.time[span])
                if (name, at, impulse) not in known:
                    share.append(found / impulse - 1.0)
        yield {
            "contact": f"stick on the {name}",
            "strokes": len(mine),
            "found": len(late),
            "late, RMS [ms]": 1e3 * rms(late),
            "impulse not known before, median error [%]": 100.0 * float(np.median(np.abs(share))),
            "largest [%]": 100.0 * float(np.max(np.abs(share))),
        }
    yield from force_rows(home, shown)
