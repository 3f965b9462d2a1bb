"""Inertial parameters of the links from motion and forces; the body's shape is in `identify.body`.

It reads no file and draws nothing.
"""
