"""Summary that `morph` prints: distances of bones, moment arms, paths, and the verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from myomorph.bones.morph.checks.warnings import KINDS, MorphChecks
from myomorph.bones.morph.morphed import Morph


def morph_lines(morph: Morph, checks: MorphChecks) -> Iterator[str]:
    """Bones, moment arms and paths with their worst place, and what the checks say."""
    yield (
        f"{len(morph.muscles)} muscles, {len(morph.points)} points transferred{_sure(morph)};"
        f" {_bones(morph)}"
    )
    if any(muscle.basis for muscle in morph.muscles):
        yield _architecture(morph)
    parts = [part for part in (_order(checks), _deepest(checks), _fibers(morph)) if part]
    if parts:
        yield "; ".join(parts)
    yield _verdict(checks)


def _sure(morph: Morph) -> str:
    """How surely points are known."""
    known = [point for point in morph.points if np.isfinite(point.within)]
    if not known:
        return ""
    worst = max(known, key=lambda point: point.within)
    middle = 1e3 * float(np.median([point.within for point in known]))
    farthest = f"{1e3 * worst.within:.2g} mm, {worst.owner} on {worst.body}"
    return f", known with 90 % to {middle:.2g} mm (median; worst {farthest})"


def _architecture(morph: Morph) -> str:
    """Where fiber lengths and forces come from, and how far they are open."""
    counts = Counter(muscle.basis or "the bones' maps" for muscle in morph.muscles)
    told = ", ".join(f"{count} by {basis}" for basis, count in counts.most_common())
    open_ = [muscle for muscle in morph.muscles if np.isfinite(muscle.force_interval[1])]
    line = f"fibers and forces of muscles: {told}"
    if not open_:
        return line
    worst = max(open_, key=lambda muscle: muscle.force_interval[1])
    middle = float(np.median([muscle.force_interval[1] for muscle in open_]))
    line += f"; 90 % intervals of force up to {middle:.2g} times as much (median)"
    return f"{line}, {worst.force_interval[1]:.2g} ({worst.name})"


def _bones(morph: Morph) -> str:
    """How far apart the bones' surfaces lie after matching."""
    measures = {body: bone.measures for body, bone in morph.bones.items()}
    apart = {
        body: known["residual [m]"] for body, known in measures.items() if "residual [m]" in known
    }
    if not apart:
        return f"{len(morph.bones)} bones without surfaces of their own to compare"
    worst = max(apart, key=lambda body: apart[body])
    values = 1e3 * np.array(list(apart.values()))
    middle = f"surfaces of {len(apart)} bones {float(np.median(values)):.2g} mm apart (median)"
    return f"{middle}, worst {worst} {1e3 * apart[worst]:.2g} mm"


def _order(checks: MorphChecks) -> str:
    """Rank correlation of the muscles' moment arms with the source's."""
    known = {name: value for name, value in checks.order.items() if np.isfinite(value)}
    if not known:
        return ""
    worst = min(known, key=lambda name: known[name])
    limit = checks.options.order
    verdict = "at least" if known[worst] >= limit else "below"
    told = (
        f"{float(np.median(list(known.values()))):.2f} (median), lowest {known[worst]:.2f}"
        f" ({worst})"
    )
    ranked = f"moment arms about {len(known)} coordinates ranked as in the source"
    return f"{ranked}: correlation {told}: {verdict} {limit:g}"


def _deepest(checks: MorphChecks) -> str:
    """Name the path that runs deeper through a bone than in the source by the most."""
    if not checks.penetrations:
        return ""
    worst = max(checks.penetrations, key=lambda penetration: penetration.increase)
    if worst.increase <= 0.0:
        return "no path runs deeper through a bone than in the source"
    where = f" at {worst.coordinate} = {np.degrees(worst.value):.0f}°" if worst.coordinate else ""
    where = f"{worst.muscle} in {worst.body}{where}; source {1e3 * worst.source:.1f} mm"
    return f"deepest new path through a bone {1e3 * worst.target:.1f} mm ({where})"


def _fibers(morph: Morph) -> str:
    """Write the ends of normalized fiber lengths over the joints' ranges."""
    known = [muscle for muscle in morph.muscles if np.isfinite([*muscle.range_target]).all()]
    if not known:
        return ""
    shortest = min(known, key=lambda muscle: muscle.range_target[0])
    longest = max(known, key=lambda muscle: muscle.range_target[1])
    least = (
        f"{shortest.range_target[0]:.2f} ({shortest.name}; source {shortest.range_source[0]:.2f})"
    )
    most = (
        f"{longest.range_target[1]:.2f} optimal lengths ({longest.name}; source"
        f" {longest.range_source[1]:.2f})"
    )
    return f"fibers work from {least} to {most}"


def _verdict(checks: MorphChecks) -> str:
    """How many warnings of which kind, and the worst."""
    if not checks.warnings:
        return "checks: no finding beyond those of the source"
    counts = Counter(warning.kind for warning in checks.warnings)
    words = {
        kind: single if counts[kind] == 1 else several
        for kind, (_, single, several) in KINDS.items()
    }
    named = ", ".join(f"{counts[kind]} {text}" for kind, text in words.items() if counts[kind])
    return (
        f"checks: {len(checks.warnings)} warnings, first in the report: {named}; first:"
        f" {checks.warnings[0].text}"
    )
