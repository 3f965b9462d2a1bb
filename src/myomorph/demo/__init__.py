"""The demonstrations of the command line: each writes its recording and its study, and runs the same steps as a user would.

What is simulated comes from `simulate`; no step of a study lives here.
"""
