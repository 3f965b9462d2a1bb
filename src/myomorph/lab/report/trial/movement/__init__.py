"""The section on a run, a jump, a squat or a rise: its numbers, and a figure of them."""
