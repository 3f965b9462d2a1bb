"""Masses of one body from its motion and the forces under its feet."""

import myomorph as mm

walk = mm.sample("walk")
options = mm.RecordingOptions(cutoff=walk.cutoff)
wrong = walk.model.with_body("torso", mass=24.0).with_mass(walk.mass)
motion = mm.inverse_kinematics(wrong, walk.markers).motion
recording = mm.usable(wrong, motion, walk.loads, options=options)
points, inside, _ = mm.body_points(wrong, mm.BodyShape(), walk.mass, mm.BodyOptions(spacing=0.02))
found = mm.identify(wrong, [recording], points, inside=inside, recording=options)
for what, model in (("assumed", wrong), ("identified", found.model), ("true", walk.model)):
    print(f"{what}: torso {model.body('torso').mass:.1f} kg")
interval = found.mass_interval("torso")
print(f"90 % interval: {interval.low:.1f} to {interval.high:.1f} kg")
for what, (moment, force) in found.residuals.items():
    print(f"{what}: {force:.1f} N and {moment:.1f} N m are left unexplained")
