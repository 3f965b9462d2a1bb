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
    `E`, `own`: `ElasticArrays`, (muscles,) the numbers in it of the muscles of the columns; `f`, `a` (frames, muscles),
    (frames - 1, muscles); `lengths`, `speeds` (frames - 1, muscles) of the paths between frames [m], [m/s]; `steps`
    (frames - 1,) time between frames [s]; `out` (frames - 1, muscles, 10) filled; `fibers` (frames - 1, muscles, 2)
    filled with normalized fiber length and velocity.
    """
    P = np.empty(10)
    for m in range(own.shape[0]):
        i = own[m]
        slack = E.hill.tendon[i]
        s0, s1, s2 = tendon_jet(E, i, f[0, m])
        for index in range(a.shape[0]):
            n0, n1, n2 = tendon_jet(E, i, f[index + 1, m])
            dt = steps[index]
            x = lengths[index, m] - 0.5 * slack * (s0 + n0)
            u = speeds[index, m] - slack * (n0 - s0) / dt
            length, velocity = fiber_jet(E, i, x, u, a[index, m], P)
            fibers[index, m, 0], fibers[index, m, 1] = length, velocity
            xk, xn, uk, un = -0.5 * slack * s1, -0.5 * slack * n1, slack * s1 / dt, -slack * n1 / dt
            g = out[index, m]
            g[0] = 0.5 * (f[index, m] + f[index + 1, m]) - P[0]
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


@kernel
def integrate(E, own, a, lengths, speeds, steps, least, most, f):
    """Normalized tendon forces of muscles with given activations, by implicit Euler steps: a start for the solver.
    `a`, `lengths`, `speeds`, `steps`: as of `elements`; `least`, `most`: bounds of the force; `f` (frames, muscles)
    filled; the first frame is in equilibrium with a tendon at rest.
    """
    P = np.empty(10)
    for m in range(own.shape[0]):
        i = own[m]
        slack = E.hill.tendon[i]
        force, s0 = 0.2, 0.0
        for index in range(-1, a.shape[0]):
            j = max(index, 0)
            rate = 0.0 if index < 0 else 1.0 / steps[j]
            low, high = least, most
            for _ in range(30):
                s, s1, _ = tendon_jet(E, i, force)
                fiber_jet(E, i, lengths[j, m] - slack * s, speeds[j, m] - slack * (s - s0) * rate, a[j, m], P)
                left = force - P[0]
                if left > 0.0:
                    high = force
                else:
                    low = force
                slope = 1.0 + slack * s1 * (P[1] + P[2] * rate)
                new = force - left / slope if slope > 0.0 else low
                if not low < new < high:
                    new = 0.5 * (low + high)
                done = abs(new - force) < 1e-3
                force = new
                if done:
                    break
            f[index + 1, m] = force
            s0, _, _ = tendon_jet(E, i, force)
