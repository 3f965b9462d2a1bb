"""What is known of a simulated recording.

It is compared with the estimate in the report, and used for nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.core.io.sto import read_sto
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Series
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import ResultWriter, file_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening, Recorded
from myomorph.lab.study.inputs.keys import File, Sentences


@dataclass(frozen=True)
class TruthFiles:
    """What is known of a simulated recording; no step reads it but the report.

    Attributes
    ----------
    true_torques : true torques of a simulated recording (.sto), columns named as coordinates [N m,
        N]
    true_activations : true activations of a simulated recording (.sto), columns named as muscles
    simulated : what was simulated, a sentence each, for the first lines of the report
    """

    true_torques: Annotated[Path | None, File(per="trial")] = None
    true_activations: Annotated[Path | None, File(per="trial")] = None
    simulated: Annotated[tuple[str, ...], Sentences()] = ()


@dataclass(frozen=True, eq=False)
class KnownTruth(Recorded):
    """True values of a simulated recording, by the names of their quantities."""

    series: Mapping[str, Series]

    def put(self, writer: ResultWriter) -> None:
        """Write each on its own clock."""
        store.put_truth(writer, self.series)


def _open(settings: TruthFiles, opening: Opening) -> Opened:
    files = (
        ("true torques", GENERALIZED_FORCE, settings.true_torques),
        ("true activations", ACTIVATION, settings.true_activations),
    )
    truth = {}
    sources = []
    for role, quantity, path in files:
        if path is not None:
            table = read_sto(path)
            truth[quantity.name] = Series(table.time, table.names, table.values, quantity=quantity)
            sources.append(file_source(role, path))
    values = (KnownTruth(FrozenMap(truth)),) if truth else ()
    return Opened(values, tuple(sources), simulated=settings.simulated)


INPUT = Input(name="truth", settings=TruthFiles, open=_open)
