"""A study file with every key and what it means, to fill in."""

from __future__ import annotations

import json
from pathlib import Path

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.settings import settings_of
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.results import write_whole

NAME = "study.toml"

TEXT = """\
# A study of swinging limbs: fill in, then  myomorph viscosity study.toml --out results

[study]
name = "shoulder"
# real = ["sentence"]       # what was measured; stands first in the report
# simulated = ["sentence"]  # what was not
# assumed = ["sentence"]    # what else is assumed

[[specimen]]               # once for each specimen
name = "01"
model = "arm.osim"         # OpenSim or MuJoCo model, its markers named as the recorded ones
removed = ["bare*.trc"]    # recordings with muscles removed; forces beside them by name, \
or in the C3D file
intact = ["full*.trc"]     # recordings with muscles intact
# measured_muscle_mass = 0.74  # of the removed muscles on a scale [kg]
# base = "scapula"  # body that is fixed to the plate; by default the one so named
# first_body = "humerus"  # first body that swings; by default the one so named
# bones = ["ulna", "radius"]  # other bodies with markers; by default those with three recorded ones
# joint = "ball"  # "ball" or "hinge"
# up = "z"  # axis of the laboratory that points up; by default the model's vertical
# muscles = { deltoid = ["delt1", "delt2"] }  # lines of action of the model that are one muscle
# pcsa = { deltoid = 12.0 }  # cross-section of each muscle, any one unit
# tare = "empty.mot"  # forces of the plate with the fixture alone
# base_mass = { removed = 0.25, intact = [0.25, 0.6] }  \
# what the base carries beyond that and does not swing [kg]: a number, or the least and the most
# plate = { placements = ["rod.c3d"], markers = ["top", "low"], axis = ["top", "low"], \
tip = 0.1 }  \
# calibrate the plate from a marked weight (mass, shares) or rod (axis, tip)
# ct = [{ bone = "humerus", surface = "humerus.stl", cluster = "cluster.stl", \
markers = ["h1", "h2", "h3"] }]  \
# scanned bones and clusters, from which the markers come
# time = [0.0, 20.0]  # part of every recording that is used [s]
# truth = { joint_viscosity = 0.055 }  # values known from elsewhere, shown beside
# paper = { joint_viscosity = 0.0761 }  # printed values, shown beside

# [[limb]]                 # a relaxed living limb that is dropped, \
beside specimens or in their place
# name = "p01"
# model = "p01.osim"       # scaled to the person: its masses count
# coordinate = "knee_angle_r"  # that swings
# drops = ["drop*.trc"]    # markers (.trc, .c3d) or coordinates (.mot, .sto); \
raw EMG beside them as drop1_emg.sto
# muscles = ["rectus_femoris"]  # channels of EMG that must be silent; by default all
# time = [0.0, 12.0]  # part of every recording that is used [s]
# truth = { viscosity = 0.2 }  # values known from elsewhere, shown beside
"""


def study_template() -> str:
    """Write the text of a study file: what must be given, and every other key commented out."""
    lines = [TEXT.removesuffix("\n")]
    for table, options in vars(StudyOptions()).items():
        lines += ["", f"[options.{table}]"]
        for setting in settings_of(type(options)):
            value = "" if setting.default is None else json.dumps(setting.default)
            words = " ".join(setting.help.split()) + ("" if value else " (chosen)")
            lines.append(f"# {setting.name} = {value}  # {words}")
    return "\n".join(lines) + "\n"


def write_template(folder: Path) -> Path:
    """Write `study.toml` into a folder, which is made; a file that is there is never replaced."""
    path = folder / NAME
    if path.exists():
        raise BadFile(path, "exists already", "give another folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(study_template(), path)
    return path
