"""The in-vitro experiment: a limb that swings on a force plate, and the viscosity of its joint and muscles.

The computation lives at this level; files and runs are in `viscosity.study`, the page in `viscosity.report`.
"""
