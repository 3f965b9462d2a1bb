"""The demonstrations of the command line: bundled recordings, run through a user's own steps.

What is simulated comes from `simulate`; no step of a study lives here.
"""
