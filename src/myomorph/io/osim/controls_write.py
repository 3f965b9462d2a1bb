"""OpenSim's file of controls (ControlSet), each given at points in time and straight between them."""

from __future__ import annotations

import os
from xml.sax.saxutils import quoteattr

from myomorph.io.parsing.text import written
from myomorph.model.series import Table

BEFORE = (
    "<is_model_control>true</is_model_control>", "<extrapolate>true</extrapolate>", "<default_min>0.02</default_min>",
    "<default_max>1</default_max>", "<filter_on>false</filter_on>", "<use_steps>false</use_steps>",
)  # fmt: skip
AFTER = ("<min_nodes />", "<max_nodes />", "<kp>100</kp>", "<kv>20</kv>")
"""What OpenSim writes of every control, whatever its bounds."""


def write_controls(table: Table, path: str | os.PathLike[str], name: str = "Control Set") -> None:
    """Write the columns of a table as controls, whole or not at all."""
    with written(path) as stream:
        stream.write('<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="40600">\n')
        stream.write(f"\t<ControlSet name={quoteattr(name)}>\n\t\t<objects>\n")
        for column, values in zip(table.names, table.values.T, strict=True):
            stream.write(f"\t\t\t<ControlLinear name={quoteattr(column)}>\n")
            stream.writelines(f"\t\t\t\t{line}\n" for line in BEFORE)
            stream.write("\t\t\t\t<x_nodes>\n")
            for time, value in zip(table.time.tolist(), values.tolist(), strict=True):
                node = f"<t>{time:.12g}</t><value>{_number(value)}</value>"
                stream.write(f"\t\t\t\t\t<ControlLinearNode>{node}</ControlLinearNode>\n")
            stream.write("\t\t\t\t</x_nodes>\n")
            stream.writelines(f"\t\t\t\t{line}\n" for line in AFTER)
            stream.write("\t\t\t</ControlLinear>\n")
        stream.write("\t\t</objects>\n\t\t<groups />\n\t</ControlSet>\n</OpenSimDocument>\n")


def _number(value: float) -> str:
    """As OpenSim's XML has it."""
    return "NaN" if value != value else f"{value:.12g}"
