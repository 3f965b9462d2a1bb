"""Pictures of the tutorials: `python -m docs_build.pictures [NAME...]`.

They are drawn from what the commands of the tutorials write. Every tutorial runs in a folder of
its own, as in the tests, with data sets from the folder that `MYOMORPH_DATA` names.
"""

from __future__ import annotations

import csv
import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import myomorph as mm
from docs_build.examples import DOCS, run_command, run_page, working_in

FOLDER = DOCS / "images" / "tutorials"
INK = "#222222"
BLUE = "#2166ac"
RED = "#b2182b"
GREY = "#999999"
RIGHT = BLUE
LEFT = RED


def walking() -> Figure:
    """Angle and torque of both knees, and three muscles with their EMG."""
    trial = xarray.open_dataset("tension/tension.nc")
    time = trial.time.values
    figure, axes = plt.subplots(
        5, 1, figsize=(7.0, 7.4), sharex=True, height_ratios=(2, 2, 1, 1, 1)
    )
    for side, color in (("r", RIGHT), ("l", LEFT)):
        angle = np.degrees(trial.coordinate_filtered.sel(coordinate=f"knee_angle_{side}").values)
        axes[0].plot(time, angle, color=color, label={"r": "right", "l": "left"}[side])
        axes[1].plot(
            time, trial.generalized_force.sel(coordinate=f"knee_angle_{side}").values, color=color
        )
    axes[0].set_ylabel("knee angle [deg]")
    axes[1].set_ylabel("knee torque [N m]")
    axes[1].axhline(0.0, color=GREY, lw=0.6)
    axes[0].legend(frameon=False, ncols=2)
    shown = (
        ("soleus_r", "soleus"),
        ("gasmed_r", "gastrocnemius"),
        ("vaslat_r", "vastus_lateralis"),
    )
    for one, (muscle, channel) in zip(axes[2:], shown, strict=True):
        envelope = trial.emg.sel(emg_channel=channel).interp(emg_time=trial.time)
        one.fill_between(time, 0.0, envelope, color="#cccccc", lw=0, label="EMG, not used")
        one.plot(time, trial.activation.sel(muscle=muscle).values, color=INK, label="activation")
        one.set_ylabel(muscle)
        one.set_ylim(0.0, 1.05)
    axes[2].legend(frameon=False, ncols=2, loc="upper right")
    axes[-1].set_xlabel("time [s]")
    return figure


def one_body() -> Figure:
    """Residuals of the walk with the generic masses and with those identified."""
    from myomorph.core.io.loads import read_external_loads

    figure, axes = plt.subplots(2, 1, figsize=(7.0, 4.4), sharex=True)
    for file, color, words in (
        ("subject01.osim", GREY, "generic masses"),
        ("identified.osim", INK, "identified masses"),
    ):
        model = mm.read_model(file)
        motion = mm.differentiate(mm.read_motion("walk1.mot", model), cutoff=6.0)
        loads = read_external_loads("opensim-gait-subject01/experiment/subject01_walk1_grf.xml")
        torques = mm.inverse_dynamics(
            model, motion, mm.resample_wrenches(loads, motion.time, cutoff=6.0)
        )
        for one, names in zip(
            axes, (("tx", "ty", "tz"), ("tilt", "list", "rotation")), strict=True
        ):
            columns = [torques.names.index(f"pelvis_{name}") for name in names]
            one.plot(
                torques.time,
                np.linalg.norm(torques.values[:, columns], axis=1),
                color=color,
                label=words,
            )
    # Near its ends the filter has nothing to lean on; these frames are not used for masses.
    axes[0].set_xlim(0.15, 2.35)
    axes[0].set_ylim(0.0, 60.0)
    axes[1].set_ylim(bottom=0.0)
    axes[0].set_ylabel("residual force [N]")
    axes[1].set_ylabel("residual moment [N m]")
    axes[1].set_xlabel("time [s]")
    axes[0].legend(frameon=False)
    return figure


def own_criterion() -> Figure:
    """Compression of the knee over time, by weight of the criterion."""
    time, *compressions = np.loadtxt("knee.csv").T
    figure, axis = plt.subplots(figsize=(7.0, 3.2))
    labels = ("least effort", "weight 0.1", "weight 1", "weight 10")
    for compression, label, color in zip(
        compressions, labels, (INK, "#92c5de", BLUE, RED), strict=True
    ):
        axis.plot(time, compression, color=color, label=label)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("compression of the knee\n[body weights]")
    axis.set_ylim(bottom=0.0)
    axis.legend(frameon=False)
    return figure


def own_contact_law() -> Figure:
    """Vertical force of both feet, with the pyramid and with the ellipse."""
    time, *feet = np.loadtxt("feet.csv").T
    figure, axes = plt.subplots(2, 1, figsize=(7.0, 4.4), sharex=True, sharey=True)
    for axis, label, (right, left) in zip(
        axes, ("pyramid", "ellipse"), (feet[:2], feet[4:]), strict=True
    ):
        axis.plot(time, right, color=RIGHT, label="right foot")
        axis.plot(time, left, color=LEFT, label="left foot")
        axis.set_ylabel(f"{label} [N]")
    axes[0].legend(frameon=False, ncols=2)
    axes[1].set_xlabel("time [s]")
    return figure


def without_plates() -> Figure:
    """Vertical force of each foot, estimated and measured."""
    found = xarray.open_dataset("no_plates/tension.nc")
    figure, axes = plt.subplots(2, 1, figsize=(7.0, 4.4), sharex=True)
    for one, side, words in zip(axes, "rl", ("right foot", "left foot"), strict=True):
        sites = [site for site in found.contact_site.values if site.endswith(f"_{side}")]
        plate = list(found.external_force_body.values).index(f"calcn_{side}")
        one.fill_between(
            found.time,
            0.0,
            found.external_force_vector.values[:, plate, 1],
            color="#cccccc",
            lw=0,
            label="plate, hidden",
        )
        estimate = found.contact_force.sel(contact_site=sites, axis="y").sum("contact_site")
        one.plot(found.time, estimate, color={"r": RIGHT, "l": LEFT}[side], label="estimate")
        one.set_ylabel(f"{words} [N]")
        one.legend(frameon=False)
    axes[1].set_xlabel("time [s]")
    return figure


def other_bones() -> Figure:
    """Errors of all muscle points by the way in which they were carried."""
    with Path("morph/errors.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    methods = [name for name in rows[0] if name.endswith("[m]")]
    figure, axis = plt.subplots(figsize=(7.0, 3.4))
    for place, method in enumerate(methods):
        errors = np.sort([1000.0 * float(row[method]) for row in rows])
        spread = 0.28 * np.sin(2.4 * np.arange(len(errors)))
        axis.plot(errors, len(methods) - 1 - place + spread, ".", color=BLUE, ms=3, alpha=0.6)
        axis.plot(
            2 * [np.median(errors)], len(methods) - 1 - place + np.array([-0.4, 0.4]), color=INK
        )
    axis.set_yticks(range(len(methods)), [name.removesuffix(" [m]") for name in reversed(methods)])
    axis.set_xlabel("distance of a muscle point from where it belongs [mm]; bars are medians")
    axis.set_xlim(left=0.0)
    return figure


def mouse() -> Figure:
    """Both ankles over a crossing, and their strikes."""
    markers = mm.read_recording("mouse-gait-c3d-force/Cage6_1R_12_01_26_trial_2.c3d").markers
    sides = (("right", "RightANKLE", RIGHT), ("left", "LeftANKLE", LEFT))
    limbs = [mm.Limb(side, (marker,)) for side, marker, _ in sides]
    found = mm.find_strides(markers, limbs, ("TAIL",), np.array([0.0, 0.0, 1.0]))
    figure, axes = plt.subplots(2, 1, figsize=(7.0, 3.6), sharex=True)
    for one, (side, marker, color) in zip(axes, sides, strict=True):
        height = 1000.0 * markers.values[:, markers.names.index(marker), 2]
        one.plot(markers.time, height, color=color)
        for strike in found.strikes[side]:
            one.axvline(strike, color=GREY, lw=0.8)
        one.set_ylabel(f"{side} ankle [mm]")
    axes[0].set_xlim(0.0, 2.9)
    axes[1].set_xlabel("time [s]; grey lines are strikes")
    return figure


def shoulder() -> Figure:
    """Angle of the limb after its release, without muscles and with them."""
    figure, axis = plt.subplots(figsize=(7.0, 2.8))
    for file, color, words in (
        ("viscosity/03/without_without_1.sto", GREY, "without muscles"),
        ("viscosity/03/with_with_1.sto", INK, "with muscles"),
    ):
        swing = mm.read_sto(file)
        axis.plot(
            swing.time,
            np.degrees(swing.values[:, swing.names.index("angle_x")]),
            color=color,
            label=words,
        )
    axis.set_xlim(0.0, 10.0)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("angle about x [deg]")
    axis.legend(frameon=False, ncols=2)
    return figure


def whole_study() -> Figure:
    """Draw the runner's right knee over the stride at both speeds."""
    with Path("results/condition_curves.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["curve"].startswith("knee_angle_r")]
    figure, axes = plt.subplots(1, 2, figsize=(7.0, 3.0))
    for axis, kind in zip(axes, ("joint angle", "joint torque"), strict=True):
        for condition, color in (("run, 2 m/s", BLUE), ("run, 5 m/s", RED)):
            curve = [
                row
                for row in rows
                if row["condition"] == condition and row["kind"].startswith(kind)
            ]
            percent = [float(row["percent"]) for row in curve]
            mean = [float(row["mean"]) for row in curve]
            axis.plot(percent, mean, color=color, label=condition)
        axis.set_ylabel(curve[0]["kind"])
        axis.set_xlabel("stride of the right foot [%]")
    axes[0].legend(frameon=False)
    return figure


def live() -> Figure:
    """Draw the torque of a knee, as estimated live and as computed afterwards.

    The live estimate is drawn at the instant when it was reported, while frames arrived.
    """
    told = xarray.open_dataset("live/live.nc")
    delay = json.loads(Path("live/session.json").read_text(encoding="utf-8"))["filter_delay_s"]
    folder = "rajagopal-walk-emg"
    model = f"{folder}/subject_walk_scaled.osim"
    run_command(
        f"myomorph ik --model {model} --markers {folder}/markers_walk.trc --out walk.mot", "live"
    )
    loads = f"--loads {folder}/grf_walk.xml --cutoff 6"
    run_command(f"myomorph id --model {model} --motion walk.mot {loads} --out torques.sto", "live")
    after = mm.read_sto("torques.sto")
    torque = told.generalized_force.sel(coordinate="knee_angle_r").values
    figure, axis = plt.subplots(figsize=(7.0, 2.8))
    axis.plot(
        after.time,
        after.values[:, after.names.index("knee_angle_r_moment")],
        color=GREY,
        label="afterwards",
    )
    axis.plot(told.time.values + delay, torque, color=INK, label="live, when it was told")
    axis.set_xlim(0.45, 1.8)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("right knee torque [N m]")
    axis.legend(frameon=False, ncols=2)
    return figure


def how_sure() -> Figure:
    """Draw moment and force of a knee with their intervals, and what contributes to them.

    The intervals are those of the usual and of better joint centers.
    """
    columns = (
        ("torques", "generalized_force", "knee_angle_l_moment", 1.0),
        ("joint_contact_forces", "joint_contact_load", "total_walker_knee_l", 1e-3),
    )
    figure, axes = plt.subplots(2, 2, figsize=(7.0, 4.8), width_ratios=(2, 1))
    for (table, quantity, column, scale), (curve, bars) in zip(columns, axes, strict=True):
        for folder, color in (("usual", "#cccccc"), ("images", "#92c5de")):
            low = mm.read_sto(f"{folder}/{table}_low.sto")
            high = mm.read_sto(f"{folder}/{table}_high.sto")
            curve.fill_between(
                low.time, scale * low[column], scale * high[column], color=color, lw=0, label=folder
            )
        wanted = column.removesuffix("_moment")
        names = list[str]()
        if table == "torques":
            trial = xarray.open_dataset("usual/tension.nc")
            curve.plot(
                trial.time.values, trial.generalized_force.sel(coordinate=wanted).values, color=INK
            )
        else:
            found = mm.read_sto(f"usual/{table}.sto")
            curve.plot(found.time, scale * found[column], color=INK)
        for folder, color, beside in (("usual", "#999999", -0.2), ("images", BLUE, 0.2)):
            with open(f"{folder}/uncertainty.csv", encoding="utf-8") as stream:
                row = next(
                    one
                    for one in csv.DictReader(stream)
                    if (one["quantity"], one["column"]) == (quantity, wanted)
                )
            if folder == "usual":
                names = [key for key in row if key.endswith("_total") and float(row[key]) > 0.01]
                bars.set_yticks(
                    np.arange(len(names)), [key.removesuffix("_total") for key in names]
                )
                bars.invert_yaxis()
            values = [100.0 * float(row[key]) for key in names]
            bars.barh(np.arange(len(names)) + beside, values, 0.4, color=color)
        bars.set_xlabel("share of the variance [%]")
    measured = np.loadtxt("knee-implant-walk/walk1_knee_force.csv", delimiter=",", skiprows=1)
    axes[1, 0].plot(
        measured[::4, 0], 1e-3 * measured[::4, 3], ".", color=RED, ms=4, label="measured"
    )
    axes[0, 0].set_ylabel("knee moment [N m]")
    axes[1, 0].set_ylabel("force in the knee [kN]")
    axes[1, 0].set_xlabel("time [s]")
    axes[1, 0].set_ylim(top=4.6)
    axes[1, 0].legend(frameon=False, ncols=3)
    return figure


DRAWN: dict[str, Callable[[], Figure]] = {
    "walking": walking,
    "one-body": one_body,
    "how-sure": how_sure,
    "own-contact-law": own_contact_law,
    "own-criterion": own_criterion,
    "without-plates": without_plates,
    "other-bones": other_bones,
    "mouse": mouse,
    "shoulder": shoulder,
    "whole-study": whole_study,
    "live": live,
}


def main(names: Sequence[str]) -> None:
    """Run tutorials and draw their pictures; all without names."""
    collection = Path(os.environ["MYOMORPH_DATA"])
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or DRAWN:
        with tempfile.TemporaryDirectory() as folder:
            run_page(DOCS / "tutorials" / f"{name}.md", Path(folder), collection.joinpath)
            plt.rcParams.update(
                {
                    "svg.hashsalt": name,
                    "svg.fonttype": "none",
                    "font.size": 9,
                    "lines.linewidth": 1.2,
                }
            )
            with working_in(Path(folder)):
                figure = DRAWN[name]()
            for one in figure.axes:
                _plain(one)
            figure.tight_layout()
            figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)


def _plain(axis: Axes) -> None:
    axis.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main(sys.argv[1:])
