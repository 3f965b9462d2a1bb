"""Runnable comparisons with OpenSim, MuJoCo and Pinocchio: `python -m benchmarks NAME`."""
