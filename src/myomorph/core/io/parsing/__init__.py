"""Text and XML from strangers: sizes checked, no entities, guarded processes for what can crash.

It knows no file format.
"""
