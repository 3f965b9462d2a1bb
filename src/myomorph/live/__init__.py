"""The steps of one frame at a time while frames arrive: sources, the chain, the session, outputs.

It computes with the kernels of the rooms below and holds no science of its own.
"""
