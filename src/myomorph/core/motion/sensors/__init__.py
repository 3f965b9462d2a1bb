"""Inertial sensors: their orientation, where they are mounted on bodies, and how their headings
drift.
"""
