"""Muscles carried to other bones and species ([D] chapters 2, 6 and 7). Knows no other guest."""
