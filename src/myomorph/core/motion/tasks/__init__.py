"""What inverse kinematics minimises, as a sum of tasks: one file per kind, see `table`."""
