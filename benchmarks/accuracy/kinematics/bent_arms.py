"""Elbows of arms that reach about, seen by centers of joints and by marker sets."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import myomorph as mm
from myomorph.core.motion.protocols import protocols
from myomorph.lab.analyze.generic_model import generic_model
from truths.made_arms import made_arms

SEEDS = range(20, 26)
SETS = ("halpe_26", "body_25b", "plug_in_gait", "rajagopal")
BACK = np.radians(-5.0)  # An elbow that bends back further is on the wrong branch [rad]

Row = dict[str, object]


def measure() -> Iterator[Row]:
    """Give a row for each set of markers."""
    for name in SETS:
        model, _ = generic_model(protocols().protocols[name].labels, arms=True)
        errors = []
        least = []
        backward = 0
        misses = []
        for seed in SEEDS:
            arms = made_arms(model, seed)
            fit = mm.inverse_kinematics(model, arms.markers)
            misses.append(float(np.nanmean(fit.rms)))
            for side in "rl":
                elbow = fit.motion[f"elbow_flexion_{side}"]
                truth = arms.motion[f"elbow_flexion_{side}"]
                errors.append(float(np.sqrt(np.mean((elbow - truth) ** 2))))
                least.append(float(elbow.min()))
                backward += bool((elbow < BACK).any())
        yield {
            "markers": name,
            "arms": len(errors),
            "arms bent back": backward,
            "minimum flexion [°]": np.degrees(min(least)),
            "error, median [°]": np.degrees(np.median(errors)),
            "error, largest [°]": np.degrees(max(errors)),
            "marker error [cm]": 100.0 * float(np.mean(misses)),
        }
