"""Drum strokes of two hands, made up, and which hand the command says made each.

Hands are two bodies that slide; nothing of the estimator makes them. Each goes from stroke to
stroke along polynomials that turn round on a drum, and moves elsewhere meanwhile. Half of the
moments are strokes of both hands on two drums, some with crossed arms.
"""

from __future__ import annotations

import contextlib
import csv
import io
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.io.wavfile import write as write_wav

import myomorph as mm
from myomorph.core.contact.strikers import change_of_velocity
from myomorph.core.io.sto import table_from_motion
from myomorph.core.model.arrays import Array
from myomorph.lab.cli.program import main
from myomorph.show.simulate.drums import RATE, Scene, Truth, heard_of, instruments

Row = dict[str, object]

HANDS = ("stick_r", "stick_l")
DRUMS = {
    "snare": np.array([0.45, 0.10, 0.70]),
    "high tom": np.array([0.55, -0.22, 0.85]),
    "bass": np.array([0.35, -0.45, 0.62]),
}
"""Places in ground, z up [m]."""
SCENE = Scene("three drums", snr=15.0, duration=20.0)
AT_ONCE = 0.015
"""Strokes of both hands are at most so far apart [s]."""
NEAR = 0.02
"""A stroke was heard where an impact is this near on its drum [s]."""
KNOWN_EVERY = 4
SURE = 0.8
SEEDS = (8100,)
"""Not used while the method was worked on (7000 was)."""
MODEL = """<mujoco model="sticks"><compiler angle="radian"/><worldbody>
<site name="above" pos="0 0 2"/>
{bodies}
</worldbody>
<tendon>{tendons}</tendon><actuator>{muscles}</actuator></mujoco>"""
BODY = """<body name="{name}"><inertial pos="0 0 0" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/>
<site name="{name}_end"/>{joints}</body>"""
TENDON = '<spatial name="{0}_lift"><site site="above"/><site site="{0}_end"/></spatial>'
MUSCLE = '<muscle name="{0}_lift" tendon="{0}_lift" lengthrange="0.5 2.5" force="200"/>'
"""Commands ask for a muscle: one lifts each stick."""


@dataclass(frozen=True)
class Stroke:
    """Hand, drum, time [s] and impulse [N s]; whether the other hand struck at the same moment."""

    hand: str
    drum: str
    time: float
    impulse: float
    paired: bool


@dataclass(frozen=True, eq=False)
class Take:
    """A recording: its strokes, and places of both hands (frames, 2, 3) at times (frames,)."""

    strokes: Sequence[Stroke]
    time: Array
    places: Array


@dataclass(frozen=True)
class Variant:
    """What is varied.

    Attributes
    ----------
    rate : of the cameras [Hz]
    crossed : share of moments with crossed hands
    noise : of places [m]
    extent : standard deviation of where a drum is struck [m]
    paired : share of moments with both hands
    """

    name: str
    rate: float = 200.0
    crossed: float = 0.25
    noise: float = 0.001
    extent: float = 0.03
    paired: float = 0.5


VARIANTS = (
    Variant("200 frames a second"),
    Variant("100 frames a second", rate=100.0),
    Variant("hands often crossed", crossed=0.5),
    Variant("places 5 mm rough, struck 6 cm apart", noise=0.005, extent=0.06),
    Variant("always both hands", paired=1.0),
)


def simulate(variant: Variant, seed: int) -> Take:
    """One take."""
    rng = np.random.default_rng(seed)
    strokes = _strokes(variant, rng)
    time = np.arange(round(SCENE.duration * variant.rate)) / variant.rate
    places = np.stack([_path(strokes, hand, variant, time, rng) for hand in HANDS], axis=1)
    return Take(strokes, time, places + variant.noise * rng.standard_normal(places.shape))


def _strokes(variant: Variant, rng: np.random.Generator) -> list[Stroke]:
    """Moments every 0.45 to 0.9 s, of one hand or of both."""
    names = list(DRUMS)
    strokes: list[Stroke] = []
    at = 1.0
    while at < SCENE.duration - 1.5:
        paired = bool(rng.uniform() < variant.paired)
        chosen = sorted(rng.choice(3, 2, replace=False)) if paired else [int(rng.integers(3))]
        # The right hand strikes further right, unless hands are crossed.
        order = list(HANDS) if rng.uniform() >= variant.crossed else list(HANDS)[::-1]
        if not paired:
            order = [str(rng.choice(HANDS))]
        for hand, number in zip(order, chosen, strict=True):
            late = rng.uniform(0.0, AT_ONCE) if paired and hand != order[0] else 0.0
            impulse = float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))
            stroke = Stroke(
                hand=hand, drum=names[number], time=at + late, impulse=impulse, paired=paired
            )
            strokes.append(stroke)
        at += rng.uniform(0.45, 0.9)
    return sorted(strokes, key=lambda stroke: stroke.time)


def _path(
    strokes: Sequence[Stroke], hand: str, variant: Variant, time: Array, rng: np.random.Generator
) -> Array:
    """Places (frames, 3) of a hand: down to each drum, up again, and about between."""
    times = [0.0]
    places = [DRUMS["snare"] + (0.0, 0.0, 0.2)]
    before = [np.zeros(3)]
    after = [np.zeros(3)]
    mine = [stroke for stroke in strokes if stroke.hand == hand]
    for index, stroke in enumerate(mine):
        middle = DRUMS[stroke.drum] + np.append(variant.extent * rng.standard_normal(2), 0.0)
        if index:
            gap = stroke.time - mine[index - 1].time
            for share in (0.4, 0.75) if gap > 0.6 else (0.5,):
                times.append(mine[index - 1].time + share * gap)
                up = np.append(0.06 * rng.standard_normal(2), rng.uniform(0.12, 0.3))
                places.append((1.0 - share) * places[-1] + share * middle + up)
                drift = 0.5 * rng.standard_normal(3)
                before.append(drift)
                after.append(drift)
        speed = 2.0 + 3.0 * stroke.impulse
        slant = 0.3 * rng.standard_normal(2)
        times.append(stroke.time)
        places.append(middle)
        before.append(np.append(slant, -speed))
        after.append(np.append(slant, 0.6 * speed))
    times.append(max(SCENE.duration, times[-1] + 0.5))
    places.append(places[-1] + (0.0, 0.0, 0.2))
    before.append(np.zeros(3))
    after.append(np.zeros(3))
    result = np.empty((len(time), 3))
    for index in range(len(times) - 1):
        ends = slice(index, index + 2)
        inside = (time >= times[index]) & (time <= times[index + 1])
        rates = np.array([after[index], before[index + 1]])
        result[inside] = CubicHermiteSpline(times[ends], places[ends], rates)(time[inside])
    return result


def write_take(take: Take, folder: Path, seed: int) -> None:
    """Model, motion, sound and contact file of a take."""
    bodies = [
        BODY.format(
            name=hand,
            joints="".join(
                f'<joint name="{hand}_t{axis}" type="slide" axis="{way}"/>'
                for axis, way in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
            ),
        )
        for hand in HANDS
    ]
    text = MODEL.format(
        bodies="\n".join(bodies),
        tendons="".join(TENDON.format(hand) for hand in HANDS),
        muscles="".join(MUSCLE.format(hand) for hand in HANDS),
    )
    (folder / "sticks.xml").write_text(text)
    names = tuple(f"{hand}_t{axis}" for hand in HANDS for axis in "xyz")
    motion = mm.Motion(take.time, names, take.places.reshape(len(take.time), -1))
    model = mm.read_model(folder / "sticks.xml")
    mm.write_sto(table_from_motion(motion, model), folder / "motion.mot")
    sound = heard_of(
        [Truth(stroke.drum, stroke.time, stroke.impulse) for stroke in take.strokes],
        SCENE,
        np.random.default_rng([seed, 1]),
    )
    write_wav(folder / "drums.wav", int(RATE), (32767 * sound.samples).astype(np.int16))
    lines = ['feet = false\n[sound]\nfile = "drums.wav"\nimpulse = "known"\n']
    for instrument in instruments(SCENE):
        mine = [stroke for stroke in take.strokes if stroke.drum == instrument.name]
        known = [[round(s.time, 4), round(s.impulse, 4)] for s in mine[::KNOWN_EVERY]]
        lines.append(
            f'[[instrument]]\nname = "{instrument.name}"\nchannel = "{instrument.channel}"\n'
            f"distance = {instrument.distance}\nsites = {list(HANDS)}\n"
            f"direction = [0.0, 0.0, 1.0]\nknown = {known}\n"
        )
    lines += [
        f'[[site]]\nname = "{hand}"\nbody = "{hand}"\npoints = [[0.0, 0.0, 0.0]]\n'
        'intervals = "file"\n'
        for hand in HANDS
    ]
    (folder / "contacts.toml").write_text("".join(lines).replace("'", '"'))


def commanded(folder: Path) -> list[dict[str, str]]:
    """Run `myomorph tension` on a take and read its table of impacts."""
    words = ["tension", "--model", "sticks.xml", "--motion", "motion.mot", "--cutoff", "0"]
    words += ["--contacts", "contacts.toml", "--out", "out"]
    said = io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
    ):
        if main(words):
            raise RuntimeError(said.getvalue())
    with (folder / "out" / "impacts.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Judged:
    """A stroke that was heard: what was found of it, and by changes of velocity alone."""

    stroke: Stroke
    site: str
    by_velocity: str
    confidence: float
    impulse: float
    holds: bool | None

    @property
    def wrong(self) -> bool:
        """Whether another hand made it."""
        return self.site != self.stroke.hand


def judged(take: Take, impacts: Sequence[dict[str, str]]) -> list[Judged]:
    """Each true stroke with the impact that was heard of it, where there is one."""
    results = []
    left = list(impacts)
    for stroke in take.strokes:
        near = [
            impact
            for impact in left
            if impact["instrument"] == stroke.drum
            and abs(float(impact["time"]) - stroke.time) < NEAR
        ]
        if not near:
            continue
        impact = min(near, key=lambda each: abs(float(each["time"]) - stroke.time))
        left.remove(impact)
        at = float(impact["time"])
        sizes = [
            np.linalg.norm(change_of_velocity(take.time, take.places[:, column], at))
            for column in range(2)
        ]
        low = impact["impulse_low"]
        results.append(
            Judged(
                stroke=stroke,
                site=impact["site"],
                by_velocity=HANDS[int(np.argmax(sizes))],
                confidence=float(impact["site_confidence"]),
                impulse=float(impact["impulse"]),
                holds=float(low) <= stroke.impulse <= float(impact["impulse_high"])
                if low
                else None,
            )
        )
    return results


def measure() -> Iterator[Row]:
    """One row for each variant, over all seeds."""
    for variant in VARIANTS:
        yield measure_variant(variant, SEEDS)


def measure_variant(variant: Variant, seeds: Sequence[int]) -> Row:
    """Strokes that were given to the right hand."""
    found: list[Judged] = []
    total = 0
    for seed in seeds:
        take = simulate(variant, seed)
        total += len(take.strokes)
        with tempfile.TemporaryDirectory(prefix="strikers_") as folder:
            write_take(take, Path(folder), seed)
            found += judged(take, commanded(Path(folder)))
    held = [each.holds for each in found if each.holds is not None]
    off = [abs(each.impulse / each.stroke.impulse - 1.0) for each in found]
    return {
        "recording": variant.name,
        "strokes": total,
        "heard": len(found),
        **_hands("at once", [each for each in found if each.stroke.paired]),
        **_hands("single", [each for each in found if not each.stroke.paired]),
        "certainty below 80 %": sum(each.confidence < SURE for each in found),
        "wrong beyond these": sum(each.confidence >= SURE and each.wrong for each in found),
        "impulse error, median": f"{np.median(off):.1%}",
        "impulse in its 90 % interval": _share(held),
    }


def _hands(what: str, strokes: Sequence[Judged]) -> Row:
    """Count strokes and those given to the right hand, by velocity alone and by the command."""
    by_velocity = [each.by_velocity == each.stroke.hand for each in strokes]
    return {
        what: len(strokes),
        f"{what}, right hand by velocity": _share(by_velocity),
        f"{what}, right hand": _share([not each.wrong for each in strokes]),
    }


def _share(right: Sequence[bool | None]) -> str:
    """Write a share as a percentage; "" of nothing."""
    if not right:
        return ""
    share = np.mean([bool(each) for each in right])
    return f"{share:.1%}"
