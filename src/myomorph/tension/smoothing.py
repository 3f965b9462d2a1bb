"""Smooth contact forces: windows of frames that are solved together, each with the frames around it.

The cost gains sum_g beta c_g (s_k z_k - s_(k-1) z_(k-1))^2 between frames in which a site touches, with
beta = smoothness (10 ms / dt)^2, so that the rate of recording does not matter. What a frame feels of another
decays with their distance by the factor r < 1 of r + 1/r = 2 + 1/beta or faster (that of an unconstrained force); a
window is solved with so many frames before and after it that what lies beyond is felt by less than `FELT`, and these
are then dropped. So windows need not know of each other: memory is that of a window, and threads change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.contact_rows import ContactTerms
from myomorph.tension.separable import Links

FELT = 1e-3
"""Share of a change beyond a window's margins that may still be felt inside it."""

CLOSE = 5e-4
"""Passes over a window end when no force is further from where they lead [body weights]."""

REFERENCE = 0.01
"""Time between frames for which the smoothness is stated [s]."""


@dataclass(frozen=True, eq=False)
class Smoothing:
    """How frames are linked.

    Attributes
    ----------
    window : frames kept of each joint solution
    margin : frames before and after them that are solved too
    scale : (frames, edges) strengths, and how much each edge is favoured
    stiffness : (frames - 1,) beta between a frame and the next
    """

    window: int
    margin: int
    scale: Array
    stiffness: Array
    over: float
    sweeps: int

    def links(self, begin: int, end: int, first: int) -> Links:
        """Links of the frames begin ... end - 1, whose edges' amplitudes begin at variable `first`."""
        scale = np.ascontiguousarray(self.scale[begin:end])
        stiffness = np.ascontiguousarray(self.stiffness[begin : end - 1])
        # Changes shrink by over - 1 from pass to pass, so what is left to come is change / (2 - over).
        tolerance = CLOSE * (2.0 - self.over)
        return Links(first, scale, np.zeros_like(scale), stiffness, self.over, self.sweeps, tolerance)


def smoothing(contacts: ContactTerms, time: Array) -> Smoothing | None:
    """Links between frames, None where nothing is smoothed.

    The factor of over-relaxation is Young's for the slowest direction of an unconstrained force.
    """
    options = contacts.task.options
    if options.smoothness == 0.0 or len(time) < 2 or not len(contacts.columns):
        return None
    stiffness = options.smoothness * (REFERENCE / np.diff(time)) ** 2
    greatest = float(stiffness.max())
    half = 1.0 + 0.5 / greatest
    decay = half - np.sqrt(half**2 - 1.0)
    margin = int(np.ceil(np.log(FELT) / np.log(decay)))
    jacobi = 2.0 * greatest / (1.0 + 2.0 * greatest)
    over = 2.0 / (1.0 + np.sqrt(1.0 - jacobi**2))
    scale = contacts.amounts / contacts.columns.weight[contacts.columns.site]
    return Smoothing(max(options.window, 2 * margin), margin, scale, stiffness, float(over), options.sweeps)
