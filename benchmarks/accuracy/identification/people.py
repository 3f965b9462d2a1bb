"""Measured people: the file of `myomorph.body.shape.people` from its sources, and its predictions.

`python -m benchmarks.accuracy.identification.people` writes the file; the surveys are public,
and lie in the folder `anthropometry-surveys` of the data collection.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from tests.data_collection import data_folder

from benchmarks.results import Row
from myomorph.body.shape import people as survey
from myomorph.core.model.arrays import Array

FILES = ("ANSUR_II_MALE.csv", "ANSUR_II_FEMALE.csv", "bdims.csv")
ANSUR: Mapping[str, str] = {
    "height": "stature",
    "chest": "chestcircumference",
    "mass": "weightkg",
    "neck": "neckcircumference",
    "upper arm": "bicepscircumferenceflexed",
    "forearm": "forearmcircumferenceflexed",
    "wrist": "wristcircumference",
    "waist": "waistcircumference",
    "hips": "buttockcircumference",
    "thigh": "thighcircumference",
    "knee": "lowerthighcircumference",
    "calf": "calfcircumference",
    "ankle": "anklecircumference",
    "upper arm length": "acromionradialelength",
    "forearm length": "radialestylionlength",
    "hip height": "trochanterionheight",
    "knee height": "lateralfemoralepicondyleheight",
    "ankle height": "lateralmalleolusheight",
    "waist height": "waistheightomphalion",
    "hips height": "buttockheight",
}
"""Columns of the public files of ANSUR II, lengths in mm, masses in 0.1 kg."""
RELAXED = 26.89 / 29.41
"""Girth of a relaxed upper arm over that of a flexed one, of the reference human of Ross and Wilson
1974."""
JOINTS = {
    ("upper arm length", "male"): 28.17 / 174.1,
    ("upper arm length", "female"): 27.51 / 173.5,
    ("forearm length", "male"): 26.89 / 174.1,
    ("forearm length", "female"): 26.43 / 173.5,
}
"""Mean lengths between joint centers over height (de Leva 1996); the survey shows how they vary."""
OTHERS: Mapping[str, str] = {
    "mass": "weight",
    "upper arm": "bicep_girth",
    "forearm": "forearm_girth",
    "wrist": "wrist_girth",
    "hips": "hip_girth",
    "thigh": "thigh_girth",
    "calf": "calf_girth",
    "ankle": "ankle_girth",
}
"""Columns of Heinz, Peterson, Johnson and Kerk 2003 whose sites are the survey's."""

MEN = "bodyfat.csv"
"""252 men of 22 to 81 years (Johnson 1996; measured by Penrose, Nelson and Fisher 1985), in pounds,
inches and centimeters. Nothing in the file of the package comes from them.
"""
MEN_TOO: Mapping[str, str] = {
    "mass": "weight",
    "wrist": "wrist",
    "hips": "hip",
    "thigh": "thigh",
    "ankle": "ankle",
}
POUND = 0.45359237  # [kg]
INCH = 0.0254  # [m]
LEAST_HEIGHT = 1.2
"""One man of 93 kg is written down with 29.5 inches [m]."""


def logs_of(rows: Sequence[Mapping[str, str]]) -> Array:
    """Compute logarithms of measurements in SI units, as they were measured.

    Parameters
    ----------
    rows : of the survey

    Returns
    -------
    (people, measurements)
    """
    scale = {name: 0.1 if name == "mass" else 0.001 for name in ANSUR}
    table = [[scale[name] * float(row[column]) for name, column in ANSUR.items()] for row in rows]
    return np.asarray(np.log(table))


def read(path: Path) -> list[dict[str, str]]:
    """Rows of a table with commas or semicolons, names of columns in lower letters."""
    lines = path.read_text("latin-1").splitlines()
    delimiter = ";" if ";" in lines[0] else ","
    lines[0] = lines[0].lower()
    return list(csv.DictReader(lines, delimiter=delimiter))


def corrected(logs: Array, sex: survey.Sex, forearm: float) -> Array:
    """Compute means of logarithms, of relaxed arms and of lengths between joint centers.

    Parameters
    ----------
    logs : (people, measurements) as measured
    sex : of the people
    forearm : logarithm of a relaxed forearm's girth over a flexed one's

    Returns
    -------
    (measurements,)
    """
    names = list(ANSUR)
    mean = logs.mean(axis=0)
    mean[names.index("upper arm")] += np.log(RELAXED)
    mean[names.index("forearm")] += forearm
    for name in ("upper arm length", "forearm length"):
        mean[names.index(name)] = mean[names.index("height")] + np.log(JOINTS[name, sex])
    return mean


def errors_of(
    logs: Mapping[survey.Sex, Array], others: Sequence[Mapping[str, str]]
) -> dict[tuple[str, str], Array]:
    """Compare people of another survey with what height and chest say of them.

    Parameters
    ----------
    logs : (people, measurements) of the survey by sex
    others : rows of the other survey

    Returns
    -------
    (people, 2) errors of logarithms, and their standard deviations by the survey alone, by
    measurement and sex
    """
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for sex, table in logs.items():
        whole = survey.People(
            names=tuple(ANSUR), mean=table.mean(axis=0), covariance=np.cov(table.T), between=0.0
        )
        for row in others:
            if row["sex"].lower() != sex:
                continue
            known = {
                "height": 0.01 * float(row["height"]),
                "chest": 0.01 * float(row["chest_girth"]),
            }
            rest = whole.given(known)
            for name, column in OTHERS.items():
                if column not in row:
                    continue
                value = float(row[column]) * (1.0 if name == "mass" else 0.01)
                error = np.log(value / rest.expected(name))
                found.setdefault((name, sex), []).append((error, rest.sd(name)))
    return {key: np.array(pairs) for key, pairs in found.items()}


def surveys() -> tuple[dict[survey.Sex, Array], list[dict[str, str]]]:
    """Read both surveys.

    Returns
    -------
    logarithms (people, measurements) of ANSUR II by sex, and the rows of the other survey; empty
    where files are absent
    """
    folder = data_folder() / "anthropometry-surveys"
    files = [folder / name for name in FILES]
    if not all(path.is_file() for path in files):
        return {}, []
    men = logs_of(read(files[0]))
    women = logs_of(read(files[1]))
    return {"male": men, "female": women}, read(files[2])


def men_of_a_third() -> list[dict[str, str]]:
    """Read the third survey's men in the second's words [kg], [cm]; none where it is absent."""
    path = data_folder() / "anthropometry-surveys" / MEN
    if not path.is_file():
        return []
    result = []
    for row in read(path):
        height = INCH * float(row["height"])
        if height < LEAST_HEIGHT:
            continue
        man = {"sex": "male", "height": str(100.0 * height), "chest_girth": row["chest"]}
        for name, column in MEN_TOO.items():
            value = float(row[column]) * (POUND if name == "mass" else 1.0)
            man[OTHERS[name]] = str(value)
        result.append(man)
    return result


def between_surveys(errors: Mapping[tuple[str, str], Array]) -> float:
    """Compute the standard deviation of errors beyond what this survey's spread explains.

    Parameters
    ----------
    errors : as of `errors_of`

    Returns
    -------
    of logarithms
    """
    sites = [pairs for (name, _), pairs in errors.items() if name != "forearm"]
    excess = [float(np.mean(np.square(e[:, 0]) - np.square(e[:, 1]))) for e in sites]
    return float(np.sqrt(np.mean(excess)))


def measure() -> Iterator[Row]:
    """Errors of what height and chest say of people of another survey."""
    logs, others = surveys()
    if not logs:
        return
    errors = errors_of(logs, others)
    between = between_surveys(errors)
    yield from _rows("Heinz et al. 2003", errors, between)
    men = men_of_a_third()
    if men:
        yield from _rows("Johnson 1996", errors_of({"male": logs["male"]}, men), between)


def _rows(
    survey_name: str, errors: Mapping[tuple[str, str], Array], between: float
) -> Iterator[Row]:
    """Compare errors of a survey's people with their standard deviations."""
    for (name, sex), pairs in errors.items():
        # The second survey's forearms are relaxed, which this file is corrected for.
        if name == "forearm":
            continue
        sd = np.hypot(pairs[:, 1], between)
        yield {
            "measurement": name,
            "sex": sex,
            "survey": survey_name,
            "people": len(pairs),
            "mean error [%]": 100.0 * float(pairs[:, 0].mean()),
            "SD of errors [%]": 100.0 * float(pairs[:, 0].std()),
            "SD by ANSUR II [%]": 100.0 * float(pairs[:, 1].mean()),
            "SD as used [%]": 100.0 * float(sd.mean()),
            "in 95 % intervals": f"{100.0 * np.mean(abs(pairs[:, 0]) < 1.96 * sd):.0f} %",
        }


def main() -> None:
    """Write the file of the package from the surveys."""
    logs, others = surveys()
    if not logs:
        raise SystemExit(f"the data folder has no anthropometry-surveys with {', '.join(FILES)}")
    errors = errors_of(logs, others)
    forearm = float(np.mean([errors["forearm", sex][:, 0].mean() for sex in logs]))
    between = between_surveys(errors)
    lines = [",".join(("sex", "measurement", "mean", "sd", "between", *ANSUR))]
    for sex, table in logs.items():
        mean = corrected(table, sex, forearm)
        correlation = np.corrcoef(table.T)
        for i, name in enumerate(ANSUR):
            row = [f"{value:.4f}" for value in correlation[i]]
            sd = f"{table[:, i].std(ddof=1):.5f}"
            lines.append(",".join((sex, name, f"{mean[i]:.5f}", sd, f"{between:.4f}", *row)))
    place = Path(survey.__file__).parent / "data" / survey.FILE
    place.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"forearm {forearm:.4f}, between surveys {between:.4f}")


if __name__ == "__main__":
    main()
