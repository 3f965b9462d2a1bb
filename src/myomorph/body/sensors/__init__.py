"""Mounting of inertial sensors on a body, and inverse kinematics with them."""
