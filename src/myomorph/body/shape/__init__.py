"""The shape of a body and the mass inside it.

Skins, envelopes, grids of mass points and the maps that weigh them. It knows no motion and no
forces.
"""
