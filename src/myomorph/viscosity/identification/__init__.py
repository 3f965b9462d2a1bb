"""The three steps of [S]: inertia of the limb, viscosity of the joint, viscosity of the muscles, with intervals.

Nothing here reads markers or files: recordings come as linear equations (`viscosity.swings`).
"""
