"""How inertial sensors sit on a body, and inverse kinematics with them."""
