"""A criterion of one's own: muscle forces with rectus femoris spared."""

import myomorph as mm

walk = mm.sample("walk")
fit = mm.inverse_kinematics(walk.model, walk.markers)
motion = mm.cut(mm.differentiate(fit.motion, cutoff=walk.cutoff), 1.0, 2.1)
loads = mm.resample_wrenches(walk.loads, motion.time, cutoff=walk.cutoff)
torques = mm.inverse_dynamics(walk.model, motion, loads)


class SpareRectus(mm.tension.Term):
    def rows(self, unknowns):
        return mm.tension.Rows.cost("rectus", unknowns.row({"recfem_r": 1.0}), 0.0, 20.0)


for what, terms in (("least effort", []), ("rectus spared", [SpareRectus()])):
    tension = mm.solve_tension(walk.model, motion, torques, terms=terms)
    force = tension.curve("muscle_force", "recfem_r").max()
    print(f"{what}: {force:.0f} N at most, effort {(tension.activation**2).sum(axis=1).mean():.3f}")
