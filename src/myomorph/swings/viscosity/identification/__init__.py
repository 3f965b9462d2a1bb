"""The three steps of [S] with intervals: inertia, viscosity of joint and of muscles.

It reads no markers or files.
"""
