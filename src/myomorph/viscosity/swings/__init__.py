"""Swings of a limb as numbers: which frames are free, the plate's clock and wrench, derivatives, sums of products.

Nothing here reads markers or identifies anything.
"""
