"""A model brought into other bones by their maps.

These are its bodies, joints, paths, wrap objects and muscle parameters. Lives here: what becomes of
each part of a model, a file for each kind of part, and `model.py` that puts them together. Never
here: how the maps were found, or a judgment of the result.
"""
