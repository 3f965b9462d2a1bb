"""Every model of the data collection: its parts, or why it does not open."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import myomorph as mm

DOCUMENT_ONLY = ("credits", "publications", "force_units", "length_units", "ModelVisualPreferences")
"""Parts of a model file that say something about it and change no result."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """A row a model file: its parts, or the reason why it is not opened."""
    mjcf = (
        "mouse-arm-muscles/akira_muscle.xml",
        "mouse-skeleton-keypoints/mouse_with_meshes.xml",
        "rat-keypoints/rodent.xml",
    )
    for path in [*sorted(folder.rglob("*.osim")), *(folder / name for name in mjcf)]:
        row: dict[str, object] = {"model": str(path.relative_to(folder))}
        try:
            model = mm.read_model(path)
        except mm.MyomorphError as error:
            yield row | {"opened": f"no: {error}"}
            continue
        kept: dict[str, int] = {}
        for part in model.kept:
            if part.kind in DOCUMENT_ONLY:
                continue
            kept[part.kind] = kept.get(part.kind, 0) + 1
        yield row | {
            "opened": "yes",
            "bodies": len(model.bodies),
            "coordinates": len(model.coordinates),
            "muscles": len(model.muscles),
            "markers": len(model.markers),
            "loops": ", ".join(loop.kind for loop in model.loops) or "-",
            "kept, not modelled": ", ".join(f"{count} {kind}" for kind, count in sorted(kept.items())) or "-",
        }
