"""One frame at a time while frames arrive: sources, the chain, the session, outputs.

It holds no science of its own.
"""
