"""The classes of muscles by their name in files. A new class is one line here, and a module with the class."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module

from myomorph.model.errors import BadModel
from myomorph.model.paths import Muscle
from myomorph.muscles.muscle_model import MuscleModel

MODELS: dict[str, str] = {
    "Thelen2003Muscle": "myomorph.muscles.models.thelen:Thelen2003",
    "Millard2012EquilibriumMuscle": "myomorph.muscles.models.millard:Millard2012",
    "Millard2012AccelerationMuscle": "myomorph.muscles.models.millard:Millard2012Acceleration",
    "DeGrooteFregly2016Muscle": "myomorph.muscles.models.degroote:DeGrooteFregly2016",
    "RigidTendonMuscle": "myomorph.muscles.models.generic:RigidTendon",
    "Thelen2003Muscle_Deprecated": "myomorph.muscles.models.thelen:DeprecatedThelen2003",
    "Schutte1993Muscle_Deprecated": "myomorph.muscles.models.generic:Schutte1993",
    "mujoco": "myomorph.muscles.models.mujoco:MujocoMuscle",
}


def muscle_model(muscle: Muscle) -> MuscleModel:
    """The class of a muscle."""
    if muscle.kind not in MODELS:
        raise BadModel(f"muscle '{muscle.name}' is a {muscle.kind}: curves are known for {', '.join(MODELS)}")
    return loaded(MODELS[muscle.kind])


@lru_cache(maxsize=64)
def loaded(place: str) -> MuscleModel:
    """The class at a place of `MODELS`."""
    module, name = place.split(":")
    model: MuscleModel = getattr(import_module(module), name)()
    return model
