"""What inverse kinematics minimises, as a sum of tasks: each kind is one file, `table` names them."""
