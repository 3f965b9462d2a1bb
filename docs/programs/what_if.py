"""What if a muscle were weaker?"""

import myomorph as mm

walk = mm.sample("walk")
fit = mm.inverse_kinematics(walk.model, walk.markers)
motion = mm.cut(mm.differentiate(fit.motion, cutoff=walk.cutoff), 1.0, 2.1)
loads = mm.resample_wrenches(walk.loads, motion.time, cutoff=walk.cutoff)
torques = mm.inverse_dynamics(walk.model, motion, loads)

for strength in (1.0, 0.5, 0.25):
    model = walk.model.with_muscle("soleus_r", strength=strength)
    tension = mm.solve_tension(model, motion, torques)
    soleus = tension.curve("muscle_force", "soleus_r").max()
    gastrocnemius = tension.curve("muscle_force", "gasmed_r").max()
    print(f"strength {strength}: soleus {soleus:.0f} N, gastrocnemius {gastrocnemius:.0f} N")
