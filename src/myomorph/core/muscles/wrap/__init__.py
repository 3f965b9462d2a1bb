"""How a path goes around one surface between two points: one file per shape."""
