"""Equilibrium of fibers and tendon between two frames, over its three unknowns, with first and second derivatives.

    G(f_k, f_k+1, a) = (f_k + f_k+1) / 2 - P(x, u, a)
    x = L - L_S (s(f_k) + s(f_k+1)) / 2          u = V - L_S (s(f_k+1) - s(f_k)) / dt

with f the normalized tendon force at the frames, a the activation between them, L and V length and velocity of the path
there, s(f) the tendon's stretch and P what the fibers pull with (`muscles.fiber_jets`). The tendon's velocity is the
difference of its own lengths, so that over any time it is as long as its speeds say.
"""

from __future__ import annotations

import numpy as np

from myomorph.muscles.fiber_jets import fiber_jet, tendon_jet
from myomorph.rigid.kernels import kernel

VALUE, FIRST, SECOND, BY_A = 0, 1, 2, 3
"""Places in `elements`: G, its slopes over f_k, f_k+1 and a; then kk, kn, nn, ka, na, aa."""


@kernel
def elements(E, own, f, a, lengths, speeds, steps, out, fibers):
    """Fill G and its derivatives of all elements.

    Parameters
    ----------
    E, own : `ElasticArrays`, (muscles,) the numbers in it of the muscles of the columns
    f, a : (frames, muscles), (frames - 1, muscles)
    lengths, speeds : (frames - 1, muscles) of the paths between frames [m], [m/s]
    steps : (frames - 1,) time between frames [s]
    out : (frames - 1, muscles, 10) filled
    fibers : (frames - 1, muscles, 2) filled with normalized fiber length and velocity
    """
    P = np.empty(10)
    for m in range(own.shape[0]):
        i = own[m]
        slack = E.hill.tendon[i]
        s0, s1, s2 = tendon_jet(E, i, f[0, m])
        for k in range(a.shape[0]):
            n0, n1, n2 = tendon_jet(E, i, f[k + 1, m])
            dt = steps[k]
            x = lengths[k, m] - 0.5 * slack * (s0 + n0)
            u = speeds[k, m] - slack * (n0 - s0) / dt
            length, velocity = fiber_jet(E, i, x, u, a[k, m], P)
            fibers[k, m, 0], fibers[k, m, 1] = length, velocity
            xk, xn, uk, un = -0.5 * slack * s1, -0.5 * slack * n1, slack * s1 / dt, -slack * n1 / dt
            g = out[k, m]
            g[0] = 0.5 * (f[k, m] + f[k + 1, m]) - P[0]
            g[1] = 0.5 - P[1] * xk - P[2] * uk
            g[2] = 0.5 - P[1] * xn - P[2] * un
            g[3] = -P[3]
            bent_k = slack * s2 * (P[2] / dt - 0.5 * P[1])
            bent_n = slack * n2 * (-P[2] / dt - 0.5 * P[1])
            g[4] = -(P[4] * xk * xk + 2.0 * P[5] * xk * uk + P[6] * uk * uk + bent_k)
            g[5] = -(P[4] * xk * xn + P[5] * (xk * un + xn * uk) + P[6] * uk * un)
            g[6] = -(P[4] * xn * xn + 2.0 * P[5] * xn * un + P[6] * un * un + bent_n)
            g[7] = -(P[7] * xk + P[8] * uk)
            g[8] = -(P[7] * xn + P[8] * un)
            g[9] = -P[9]
            s0, s1, s2 = n0, n1, n2
