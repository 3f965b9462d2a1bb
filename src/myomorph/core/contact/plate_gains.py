"""A plate that measures another share of the body's weight than the others do.

While one plate alone carries the body, it has to measure what the center of mass needs. A wrong
mass makes all plates measure the same share, a wrong sensitivity one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from myomorph.core.contact.force_balance import balance
from myomorph.core.contact.force_inspection import GAIN, Inspection, supported
from myomorph.core.model.causes import WEIGHT
from myomorph.core.model.findings import Finding
from myomorph.core.model.severity import FORCE_ERROR, severity_of

ALONE = 0.93  # Share of the force of all plates that one of them measures where it carries alone.
MIN_TIME = 0.15  # That a plate has to carry the body alone [s].
MIN_FRAMES = 8
RIGHT = 0.09  # Part by which the others may differ from the model's weight.
APART = 0.145
"""Part by which the plate differs from them: 0.02 in most clean walks, 0.14 where two plates were
not set to zero.
"""
SPREAD = 0.3  # Range of that share over nine of ten frames, above which it is no sensitivity.


@dataclass(frozen=True, kw_only=True)
class Share:
    """What a plate measures over what the body needs, while it carries the body alone.

    Attributes
    ----------
    number : of the force
    ratio : of the sums over time [-]
    spread : range of the ratio that holds eight of ten frames [-]
    """

    number: int
    ratio: float
    spread: float


def check_gains(inspection: Inspection) -> Iterator[Finding]:
    """Find plates whose sensitivity is not that of the others, which measure the body's weight."""
    shares = _shares(inspection)
    if len(shares) < 2:
        return
    names = [inspection.name(share.number) for share in shares]
    for share, name in zip(shares, names, strict=True):
        others = [other.ratio for other in shares if other is not share]
        right = all(abs(ratio - 1.0) < RIGHT for ratio in others)
        apart = min(abs(share.ratio / ratio - 1.0) for ratio in others)
        if not right or apart < APART or share.spread > SPREAD * share.ratio:
            continue
        change = 100.0 * (share.ratio - 1.0)
        beside = ", ".join(f"'{other}'" for other in names if other != name)
        text = WEIGHT.message(
            f"force '{name}' carries {share.ratio:.2f} times the body's weight where it alone"
            f" carries the body, and {beside} {float(np.mean(others)):.2f} times: check the"
            " calibration of its plate (gain, range)",
            size=change,
            severity=severity_of(change, 100.0 * FORCE_ERROR),
        )
        yield Finding(GAIN, name, text)


def _shares(inspection: Inspection) -> list[Share]:
    """Share of the weight that each plate measures; of those that carry the body alone."""
    result = balance(inspection)
    if result is None:
        return []
    up = inspection.feet.up
    time = inspection.feet.time
    wanted = result.needed @ up
    carried = inspection.samples.forces @ up
    total = carried.sum(axis=1)
    usable = supported(inspection) & (wanted > 0.5 * inspection.feet.model.weight)
    margin = max(2, len(time) // 25)
    usable[:margin] = False
    usable[-margin:] = False
    min_count = max(MIN_FRAMES, MIN_TIME / float(np.median(np.diff(time))))
    shares = []
    for number in inspection.numbers:
        alone = usable & (carried[:, number] > ALONE * total) & (carried[:, number] > 0.0)
        if alone.sum() < min_count:
            continue
        measured = result.measured[alone] @ up
        low, high = np.percentile(measured / wanted[alone], [10.0, 90.0])
        share = Share(
            number=number,
            ratio=float(measured.sum() / wanted[alone].sum()),
            spread=float(high - low),
        )
        shares.append(share)
    return shares
