"""Models that the package `myo-sim` composes in memory, by name: arm, legs, hands and the whole body of MyoSuite."""

from __future__ import annotations

import os

from myomorph.io.formats import COMPOSED
from myomorph.io.mjcf.compile import silent_mujoco
from myomorph.io.mjcf.read import model_from_mujoco
from myomorph.model.errors import BadData, BadFile
from myomorph.model.model import Model


def composed_model(name: str | os.PathLike[str]) -> Model:
    """A model of `myo-sim`, with its bones.

    Source: MyoSuite (Caggiano et al. 2022); models of the package `myo-sim`.

    Parameters
    ----------
    name : as the package has it ("myoarm", "myolegs", ...), with `myo-sim:` before it or without

    Raises
    ------
    BadData : the package is not installed
    BadFile : it has no such model
    """
    name = os.fspath(name).removeprefix(COMPOSED)
    try:
        # Loaded only where one of its models is asked for.
        import myo_sim
    except ImportError:
        raise BadData(f"the model '{name}' comes with the package 'myo-sim': pip install myo-sim") from None
    with silent_mujoco():
        try:
            spec = myo_sim.load_spec(name)
        except ValueError as error:
            raise BadFile(COMPOSED + name, "no such model of myo-sim", str(error)) from None
        compiled = spec.compile()
    # Meshes are looked for beside a model's source.
    return model_from_mujoco(compiled, name=name, source=str(myo_sim.MODELS_DIR / name))
