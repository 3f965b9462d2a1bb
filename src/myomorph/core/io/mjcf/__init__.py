"""MuJoCo's XML, compiled by MuJoCo in a guarded process, into a `Model`.

No MuJoCo object leaves this folder.
"""
