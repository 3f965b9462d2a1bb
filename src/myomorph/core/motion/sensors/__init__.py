"""Inertial sensors on bodies: their orientation, mounting and drift of headings."""
