"""Accuracy of the experiment with swinging limbs, and of the instruments it needs."""
