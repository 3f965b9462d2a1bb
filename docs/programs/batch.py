"""A folder of recordings to one table."""

import myomorph as mm

for number in (1, 2):
    files = mm.sample("walk", number).write("recordings", name=f"simulated_walk_{number}")
analysis = mm.analyze(
    "recordings", "results", mass=70.0, model=files.model, keys={"time": [0.1, 2.6]}
)
table = analysis.to_pandas()
wanted = [
    "knee_angle_r, range in a stride",
    "ankle_angle_r_moment, minimum",
    "soleus_r_force, maximum",
]
chosen = table[table.quantity.isin(wanted)]
print(chosen.pivot(index="quantity", columns="trial", values="value").round(1))
