"""Inputs of a trial: each declared once, as settings, where it is found, and how it is opened."""
