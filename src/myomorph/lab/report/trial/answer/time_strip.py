"""Stretches of time that a cause concerns, as a strip over the whole trial."""

from __future__ import annotations

from collections.abc import Sequence

from myomorph.core.model.findings import times_text
from myomorph.core.model.messages import Span

WIDTH = 600.0
HEIGHT = 14.0
"""Of the drawing, which is stretched to the width of its section [px]."""
MIN_WIDTH = 2.0
"""Of a stretch, so that a single frame is seen [px]."""


def time_strip(spans: Sequence[Span], whole: Span) -> str:
    """Draw stretches of time over a trial as an SVG.

    Parameters
    ----------
    spans : first and last time of each [s]
    whole : of the trial [s]

    Returns
    -------
    the drawing, with a title for those who do not see it
    """
    start, stop = whole
    scale = WIDTH / max(stop - start, 1e-9)
    marks = []
    for first, last in spans:
        left = min(max((first - start) * scale, 0.0), WIDTH - MIN_WIDTH)
        width = min(max((last - first) * scale, MIN_WIDTH), WIDTH - left)
        marks.append(f'<rect x="{left:.1f}" y="2" width="{width:.1f}" height="{HEIGHT - 4.0:g}"/>')
    title = f"{times_text(spans)}, of {start:.2f} to {stop:.2f} s"
    return (
        f'<svg class="strip" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none"'
        f' role="img" aria-label="{title}"><title>{title}</title>'
        f'<path d="M0 {0.5 * HEIGHT:g}H{WIDTH:g}"/>{"".join(marks)}</svg>'
    )
