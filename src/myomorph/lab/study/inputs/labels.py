"""What the model calls markers that the recording calls otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.results import value_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import LabelMap


@dataclass(frozen=True)
class Labels:
    """Names of markers.

    Attributes
    ----------
    labels : Names of markers (.csv with lines "recorded,model", or .toml); an empty model name
        drops a marker.
    """

    labels: Annotated[Mapping[str, str], LabelMap()] = field(default_factory=lambda: FrozenMap({}))


def _open(settings: Labels, opening: Opening) -> Opened:
    # The markers are renamed where they are read.
    return Opened(
        sources=(value_source("markers", "labels of markers", sorted(settings.labels.items())),)
    )


INPUT = Input(name="labels", settings=Labels, open=_open)
