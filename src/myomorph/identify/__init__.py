"""Inertial parameters of the links from motion, forces and body shape."""
