"""Models as MuJoCo can hold them, written with a certificate of what differs.

Writing XML is the work of `io.mjcf`; MuJoCo's objects stay there.
"""
