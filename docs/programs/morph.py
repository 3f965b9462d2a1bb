"""A muscle model in other bones: a thigh that is 8 % longer and 4 % narrower."""

import numpy as np

import myomorph as mm

leg = mm.sample("walk").model
bone = mm.source_bones(leg)["femur_r"]
scan = mm.Surface(bone.vertices * [0.96, 1.08, 0.96], bone.faces)
maps = {"femur_r": mm.map_bone("femur_r", bone, scan)}
morph = mm.morph_model(leg, maps, target=mm.morph.MorphTarget(name="longer thigh"))
for model in (leg, morph.model):
    lengths = mm.muscle_kinematics(model, mm.Motion([0.0], (), np.zeros((1, 0))), velocities=False)
    for muscle in ("vaslat_r", "semiten_r"):
        length = lengths.curve("muscle_length", muscle)[0]
        print(f"{model.name}: {muscle} {100 * length:.1f} cm")
