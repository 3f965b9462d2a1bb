"""Figures of bones: `python -m benchmarks.figures species-leg`, `morph-shapes`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

import myomorph as mm
from benchmarks.accuracy.morph.shapes import PLACES, carried, cases, every_map, foreseen
from benchmarks.figures.page import legend, page
from benchmarks.species_cases import Bodies, anatomist_on_skeleton, from_man, man, mouse
from data_collection import data_folder
from myomorph.bones.morph.species.counterparts import Posed
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.muscles.model_paths import compile_paths

METHOD = "SSD"
BENT = 0.5 * np.pi
POSTURES = {
    "man": {"hip_flexion_r": BENT, "knee_angle_r": BENT},
    "mouse": {"mouse__RKnee_flexion": -BENT},
}
MAN = ("pelvis", "femur_r", "tibia_r", "patella_r", "talus_r", "calcn_r", "toes_r")
MOUSE = ("mouse", "mouse__RFemur", "mouse__RTibia", "mouse__RTarsus")
FEET = tuple(f"mouse__R{part}{i}" for part in ("Metatarsus", "BPhalange") for i in range(1, 6))
SIDES = {
    "man": np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "mouse": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""Rows across and up the page, in the pelvis's frame: both are on all fours and look to the left.
"""
SHOWN = {
    "glmed2_r": "gluteus medius",
    "iliacus_r": "iliacus",
    "semimem_r": "semimembranosus",
    "bflh_r": "biceps femoris",
    "grac_r": "gracilis",
    "recfem_r": "rectus femoris",
    "vaslat_r": "vastus lateralis",
    "gasmed_r": "gastrocnemius, medial",
    "soleus_r": "soleus",
    "tibant_r": "tibialis anterior",
    "edl_r": "extensor digitorum longus",
    "fdl_r": "flexor digitorum longus",
    "perlong_r": "peroneus longus",
}


def draw(file: Path) -> None:
    """Man's own leg, the mouse's with the man's muscles, and with the anatomist's."""
    data = data_folder()
    ours = man(data)
    theirs = mouse(data)
    moved = from_man(data, METHOD).model
    anatomist = anatomist_on_skeleton(data).model
    homologues = {name: read_species("human-mouse").homologous(name) for name in SHOWN}
    colors = dict(zip(SHOWN, plt.get_cmap("tab20").colors, strict=False))
    with page(file, 1, 3, (9.6, 4.6), span=(0.14, 1.0)) as (figure, axes):
        one = {name: (name,) for name in SHOWN}
        _leg(axes[0], ours, ours.model, MAN, "man", one, colors)
        _leg(axes[1], theirs, moved, (*MOUSE, *FEET), "mouse", one, colors)
        _leg(axes[2], theirs, anatomist, (*MOUSE, *FEET), "mouse", homologues, colors)
        for shown, title in zip(
            axes,
            ("man", f"mouse, the man's muscles ({METHOD})", "mouse, the anatomist's"),
            strict=True,
        ):
            shown.set_title(title, fontsize=9)
            shown.set_aspect("equal")
            shown.axis("off")
        handles = [
            plt.Line2D([], [], color=colors[name], lw=2, label=word) for name, word in SHOWN.items()
        ]
        figure.legend(handles=handles, loc="lower center", ncols=5, frameon=False, fontsize=8)


def _leg(
    axes: Axes,
    bones: Bodies,
    model: mm.Model,
    bodies: tuple[str, ...],
    species: str,
    wanted: Mapping[str, tuple[str, ...]],
    colors: Mapping[str, tuple[float, float, float]],
) -> None:
    posture = POSTURES[species]
    side = SIDES[species]
    root = bodies[0]
    posed = Posed(model, posture)
    for body in bodies:
        if body in bones.surfaces:
            surface = bones.surfaces[body]
            flat = posed.within(body, root).apply(surface.vertices) @ side.T
            axes.add_collection(
                PolyCollection(flat[surface.faces], facecolor="#e3ddd0", rasterized=True)
            )
    names = tuple(posture)
    at = mm.Motion(np.zeros(1), names, np.array([[posture[one] for one in names]]))
    paths = compile_paths(model)
    nodes = paths.nodes(paths.tree.coordinates_of(at))[0, :, :, :3]
    root_pose = posed.within("ground", root)
    for name, parts in wanted.items():
        for part in parts:
            points = nodes[model.muscle_names.index(part)]
            flat = root_pose.apply(points[np.isfinite(points[:, 0])]) @ side.T
            axes.plot(flat[:, 0], flat[:, 1], color=colors[name], lw=1.6, solid_capstyle="round")
    axes.autoscale_view()


COUNTS = (4, 6, 8, 12, 16, 24, 36)
MAPS = {
    "per-axis scaling, distances": ("per-axis scaling", "#777777", "-"),
    "affine": ("affine", "#e08214", "-"),
    "RBF, r": ("RBF, r", "#2166ac", "-"),
    "SSD": ("SSD", "#b2182b", "-"),
}


def draw_errors(file: Path) -> None:
    """Mean error of attachments over the number of landmarks, in both places."""
    with page(file, 1, len(PLACES), (8.4, 3.6), sharey=True, span=(0.0, 0.92)) as (figure, axes):
        makers = every_map()
        for axis, (where, landmarks) in zip(axes, PLACES.items(), strict=True):
            for name, (words, color, style) in MAPS.items():
                errors = [
                    carried(makers[name], partial(landmarks, count=n), cases("mean")).on.mean()
                    for n in COUNTS
                ]
                axis.plot(
                    COUNTS,
                    1e3 * np.array(errors),
                    style,
                    color=color,
                    marker="o",
                    ms=3,
                    lw=1.4,
                    label=words,
                )
                if words == "per-axis scaling":
                    axis.plot(
                        COUNTS, 5e2 * np.array(errors), ":", color=color, lw=1.0, label="half of it"
                    )
            predicted = [1e3 * foreseen(partial(landmarks, count=n)) for n in COUNTS]
            axis.plot(
                COUNTS,
                predicted,
                "--",
                color="#1b7837",
                lw=1.2,
                label="regression on other persons",
            )
            axis.set_title(
                f"landmarks {where}" if where.startswith("at") else f"landmarks at {where}",
                fontsize=9,
            )
            axis.set_xlabel("landmarks on each bone")
            axis.set_xticks(COUNTS, [str(n) for n in COUNTS])
        axes[0].set_ylabel("mean error of attachments [mm]")
        axes[0].set_ylim(0.0, 6.5)
        legend(figure, axes[0], 6, fontsize=8)
