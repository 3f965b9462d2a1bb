"""Tensions, joint loads and what personalizes them."""
