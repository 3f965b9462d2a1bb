"""Markers to coordinates: inverse kinematics, filters, derivatives, clocks. Knows no forces."""
