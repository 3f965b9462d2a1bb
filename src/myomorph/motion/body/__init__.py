"""The problem that all frames of a body share: its unknowns, its priors, and what fixes the zero of every angle."""
