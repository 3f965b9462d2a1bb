"""A measured swing, and mass centers and inertias from periods of swings.

Its authors computed the latter. Data and definitions of Moore, Hubbard, Peterson, Schwab, Kooijman
2010 and Moore 2012: every part of a bicycle hung as a compound and as a torsional pendulum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.optimize import brentq

from myomorph.core.model.arrays import Array
from truths.decays import Decay, compare_decays, compound_inertia, fit_decay, torsional_inertia

BICYCLES = ("Browser", "Pista", "Rigid")
RECORDING = "BrowserForkCompoundFirst1.mat"

Row = dict[str, object]
Numbers = Mapping[str, tuple[float, float]]
"""Value and standard error by name."""


def measure_decay(folder: Path) -> Iterator[Row]:
    """Laws of damping fitted to the recorded swing of a fork."""
    folder = folder / "pendulum-swing-inertia"
    if not folder.exists():
        return
    time, signal = _recording(folder)
    fits = compare_decays(time, signal)
    least = min(one.bic for one in fits)
    for one in fits:
        yield {
            "damping": " + ".join(one.terms),
            "period at small amplitude [s]": f"{one.period:.5f} +- {one.period_sd:.5f}",
            "viscous [1/s]": (
                f"{one.viscous:.5f} +- {one.viscous_sd:.5f}" if "viscous" in one.terms else ""
            ),
            "coulomb [V/s]": one.coulomb if "coulomb" in one.terms else "",
            "quadratic [1/(V s)]": one.quadratic if "quadratic" in one.terms else "",
            "decrement at 1 V, at 0.4 V": f"{one.decrement(1.0):.4f}, {one.decrement(0.4):.4f}",
            "residual [mV]": 1e3 * one.residual,
            "BIC above the best": one.bic - least,
        }


def measure_periods(folder: Path) -> Iterator[Row]:
    """Period, damping and inertia of the fork from the recording, beside what the authors print."""
    folder = folder / "pendulum-swing-inertia"
    if not folder.exists():
        return
    measured = _numbers(folder / "BrowserMeasured.txt")
    printed = _numbers(folder / "BrowserBenchmark.txt")
    time, signal = _recording(folder)
    as_authors = fit_decay(*_their_part(time, signal), ("viscous",), bend=False)
    best = min(compare_decays(time, signal), key=lambda one: one.bic)
    theirs, error = measured["TcH1"]
    for name, fit in (
        ("the authors' law: one frequency, viscous", as_authors),
        (_words(best), best),
    ):
        inertia = propagated(lambda x, T=fit.period: _parts(x | {"TcH1": T})["IHyy"], measured)
        distance = _distance(measured)
        mass = measured["mH"][0]
        yield {
            "fit": name,
            "period [s]": f"{fit.period:.5f} +- {fit.period_sd:.5f}",
            "error by the authors' formula [s]": fit.period_sd_white,
            "authors' TcH1 [s]": f"{theirs:.5f} +- {error:.1e}",
            "off [%]": 100.0 * (fit.period / theirs - 1.0),
            "fork inertia IHyy [kg m2]": f"{inertia[0]:.4f} +- {inertia[1]:.4f}",
            "authors' IHyy": "{:.4f} +- {:.4f}".format(*printed["IHyy"]),
            "off, in their errors": (inertia[0] - printed["IHyy"][0]) / printed["IHyy"][1],
            "viscosity [N m s/rad]": fit.viscosity(inertia[0] + mass * distance**2),
            "friction [N m]": (
                fit.friction(mass * measured["g"][0] * distance) if fit.coulomb > 0.0 else ""
            ),
        }


def measure_inertias(folder: Path) -> Iterator[Row]:
    """Compute geometry, mass centers and inertias by our formulas.

    They are from the authors' measured periods and lengths.
    """
    folder = folder / "pendulum-swing-inertia"
    for bicycle in BICYCLES if folder.exists() else ():
        measured = _numbers(folder / f"{bicycle}Measured.txt")
        printed = _numbers(folder / f"{bicycle}Benchmark.txt")
        for kind, names in (
            ("geometry", ("rF", "rR", "lam", "c", "w")),
            ("mass centers", tuple(name for name in printed if name[0] in "xz" and len(name) == 2)),
            ("inertias", tuple(name for name in printed if name.startswith("I"))),
        ):
            rows = []
            for name in names:
                value, error = propagated(lambda x, name=name: _parts(x)[name], measured)
                rows.append(
                    (name, (value - printed[name][0]) / printed[name][1], error / printed[name][1])
                )
            worst_name, worst, _ = max(rows, key=lambda one: abs(one[1]))
            within = sum(abs(off) <= 1.0 for _, off, _ in rows)
            ratios = [ratio for _, _, ratio in rows]
            yield {
                "bicycle": bicycle,
                "parameters": kind,
                "within one standard error of the authors": f"{within} of {len(rows)}",
                "worst, in standard errors": f"{worst:+.1e} ({worst_name})",
                "our standard error over theirs": f"{min(ratios):.3f} to {max(ratios):.3f}",
            }


def propagated(
    function: Callable[[dict[str, float]], float], given: Numbers
) -> tuple[float, float]:
    """Value and standard error of a function of independent numbers, to first order."""
    at = {name: value for name, (value, _) in given.items()}
    square = 0.0
    for name, (value, error) in given.items():
        if error > 0.0:
            step = 0.01 * error
            change = function(at | {name: value + step}) - function(at | {name: value - step})
            square += (change / (2.0 * step) * error) ** 2
    return function(at), float(np.sqrt(square))


def _recording(folder: Path) -> tuple[Array, Array]:
    held = loadmat(folder / RECORDING, squeeze_me=True)
    signal = np.asarray(held["data"], dtype=np.float64)
    return np.arange(len(signal)) / float(held["ActualRate"]), signal


def _their_part(time: Array, signal: Array) -> tuple[Array, Array]:
    """Signal from its largest deviation to the last above 10 % of it, as the authors cut it."""
    size = signal - signal.mean()
    first = int(np.abs(size).argmax())
    last = int(np.flatnonzero(size > 0.1 * np.abs(size).max())[-1])
    return time[first:last], signal[first:last]


def _numbers(path: Path) -> dict[str, tuple[float, float]]:
    """Every number of a file; several of one name as their mean."""
    found = {}
    for line in path.read_text().splitlines():
        name, _, text = line.partition("=")
        if text and not name.startswith("#"):
            pairs = [
                [float(x) for x in one.replace(" ", "").split("+/-")] for one in text.split(",")
            ]
            errors = [pair[1] if len(pair) > 1 else 0.0 for pair in pairs]
            mean = float(np.mean([pair[0] for pair in pairs]))
            found[name.strip()] = (mean, float(np.linalg.norm(errors)) / len(pairs))
    return found


def _words(fit: Decay) -> str:
    return " + ".join(fit.terms) + ", period by amplitude"


def _distance(measured: Numbers) -> float:
    """Of the fork's mass center from the front wheel's axle, the axis of its swing [m]."""
    at = {name: value for name, (value, _) in measured.items()}
    parts = _parts(at)
    return float(np.hypot(parts["xH"] - parts["w"], parts["zH"] + parts["rF"]))


def _geometry(x: Mapping[str, float]) -> dict[str, float]:
    """Wheel radii, steer axis tilt, wheelbase and trail of the benchmark bicycle."""
    rF = x["dF"] / (2.0 * np.pi * x["nF"])
    rR = x["dR"] / (2.0 * np.pi * x["nR"])
    if "w" in x:
        lam = np.deg2rad(90.0 - x["gamma"])
        w = x["w"]
        offset = x["f"]
    else:
        a = x["h1"] + x["h2"] - x["h3"] + 0.5 * (x["d1"] - x["d2"])
        offset = x["h4"] - x["h5"] + 0.5 * (x["d4"] - x["d3"])
        along = np.sqrt((x["d"] + 0.5 * (x["d2"] + x["d3"])) ** 2 - (a - offset) ** 2)
        lam = brentq(
            lambda t: rF - rR + along * np.cos(t) - (a + offset) * np.sin(t), 0.0, 0.5 * np.pi
        )
        w = (a + offset) * np.cos(lam) + along * np.sin(lam)
    return {
        "rF": rF,
        "rR": rR,
        "lam": float(lam),
        "w": w,
        "c": (rF * np.sin(lam) - offset) / np.cos(lam),
    }


def _parts(x: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the benchmark bicycle: planar mass centers and the inertias about them."""
    par = _geometry(x)
    tube = x["mP"] / 12.0 * (0.75 * x["dP"] ** 2 + x["lP"] ** 2)

    def hung(name: str) -> float:
        return torsional_inertia(tube, x["TtP1"], x[f"Tt{name}"])

    for wheel in "FR":
        compound = compound_inertia(x[f"m{wheel}"], x["g"], x[f"l{wheel}"], x[f"Tc{wheel}1"])
        par |= {f"I{wheel}xx": hung(f"{wheel}1"), f"I{wheel}yy": compound}
    split = "mS" in x
    axes = {"B": (0.0, par["rR"]), "H": (par["w"], par["rF"])}
    if split:
        u1, u2 = _handlebar(x, par["lam"])
        axes |= {"S": axes["H"], "G": (par["w"] - u1, par["rF"] + u2)}
    for part in ("B", *("SG" if split else "H")):
        turns = [i for i in range(1, 7) if f"alpha{part}{i}" in x]
        beta = par["lam"] - np.deg2rad([x[f"alpha{part}{i}"] for i in turns])
        level, height = axes[part]
        center = _mass_center(beta, np.array([x[f"a{part}{i}"] for i in turns]), level, height)
        about = np.stack([np.cos(beta) ** 2, -np.sin(2.0 * beta), np.sin(beta) ** 2], axis=1)
        planar = np.linalg.lstsq(about, [hung(f"{part}{i}") for i in turns], rcond=None)[0]
        distance = float(np.hypot(center[0] - level, center[1] + height))
        par |= {f"x{part}": center[0], f"z{part}": center[1]}
        par |= dict(zip((f"I{part}xx", f"I{part}xz", f"I{part}zz"), planar, strict=True))
        par[f"I{part}yy"] = compound_inertia(x[f"m{part}"], x["g"], distance, x[f"Tc{part}1"])
    return par | _joined(x, par) if split else par


def _mass_center(beta: Array, offsets: Array, level: float, height: float) -> Array:
    """(2,) mean intersection of the lines drawn on a hanging part below its axis."""
    slopes = -np.tan(beta)
    intercepts = -offsets / np.cos(beta) - height + level * np.tan(beta)
    first, second = np.triu_indices(len(beta), 1)
    x = (intercepts[second] - intercepts[first]) / (slopes[first] - slopes[second])
    return np.array([x.mean(), (slopes[first] * x + intercepts[first]).mean()])


def _handlebar(x: Mapping[str, float], lam: float) -> tuple[float, float]:
    """Return the handlebar's reference point from the front axle, level and up [m]."""
    across = x["h7"] - x["h6"] + 0.5 * (x["d5"] - x["d6"])
    along = np.sqrt((x["l"] - 0.5 * (x["d5"] + x["d6"])) ** 2 - across**2)
    u1 = along * np.sin(lam) - across * np.cos(lam)
    return u1, u1 / np.tan(lam) + across / np.sin(lam)


def _joined(x: Mapping[str, float], par: Mapping[str, float]) -> dict[str, float]:
    """Fork S and handlebar G as one part H."""
    masses = np.array([x["mS"], x["mG"]])
    centers = np.array([[par[f"x{part}"], par[f"z{part}"]] for part in "SG"])
    center = masses @ centers / masses.sum()
    total = np.zeros(4)
    for part, mass, (dx, dz) in zip("SG", masses, centers - center, strict=True):
        own = np.array([par[f"I{part}{axes}"] for axes in ("xx", "xz", "yy", "zz")])
        total += own + mass * np.array([dz**2, -dx * dz, dx**2 + dz**2, dx**2])
    names = ("IHxx", "IHxz", "IHyy", "IHzz")
    return {"xH": center[0], "zH": center[1], **dict(zip(names, total, strict=True))}
