"""Swings as numbers: free frames, the plate's clock and wrench, derivatives, sums.

It reads and identifies nothing.
"""
