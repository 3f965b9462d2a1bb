"""Pictures of models and motions for notebooks, by the renderer of the report's pages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.report.scene.scene import Acting, make_scene
from myomorph.lab.report.trial.answer.pose_pictures import PosePicture, pose_pictures
from myomorph.lab.study.trial.reporting import reduced_for_pictures, surfaces_of

HEIGHT = 260  # Of a picture in a notebook [pixels].
SHARES = (0.1, 0.5, 0.9)
"""Of the motion, at which it is pictured."""


def model_picture(model: Model) -> str:
    """Draw a model in its default pose, as HTML."""
    tree = compile_tree(model)
    rest = Motion(np.zeros(1), model.coordinate_names, tree.defaults[None])
    return poses_picture(model, rest, (0,))


def motion_picture(model: Model, motion: Motion, activations: Series | None = None) -> str:
    """Draw three poses of a motion, as HTML; "" where no frame is known.

    Parameters
    ----------
    model : that moves
    motion : (frames, coordinates) [rad or m]
    activations : of the muscles, where they are known
    """
    known = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(known):
        return ""
    frames = [int(known[int(share * (len(known) - 1))]) for share in SHARES]
    return poses_picture(model, motion, frames, activations)


def poses_picture(
    model: Model, motion: Motion, frames: Sequence[int], activations: Series | None = None
) -> str:
    """Draw frames of a motion side by side, as HTML.

    Parameters
    ----------
    model : that moves
    motion : (frames, coordinates) [rad or m]
    frames : numbers of those that are drawn
    activations : of the muscles, where they are known
    """
    surfaces = reduced_for_pictures(surfaces_of(model))
    scene = make_scene(model, motion, frames, surfaces, Acting(activations))
    return "".join(_image(picture) for picture in pose_pictures(model, scene))


def _image(picture: PosePicture) -> str:
    dark = f"<source srcset='{picture.dark}' media='(prefers-color-scheme: dark)'/>"
    light = f"<img src='{picture.light}' style='height:{HEIGHT}px' alt='pose of the body'/>"
    return f"<picture>{dark}{light}</picture>"
