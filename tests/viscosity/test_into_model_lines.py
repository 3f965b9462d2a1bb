"""What is said of the muscles that a model gets is what their lines of action get."""

from __future__ import annotations

from types import SimpleNamespace

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.passive_dynamics import line_viscosity
from myomorph.swings.viscosity.identified_model import Dampers
from myomorph.swings.viscosity.study.into_model import _lines


def told(lines):
    """Print the lines for muscles of 12 N s/m that consist of these lines."""
    muscles = dict.fromkeys(lines, 12.0)
    report = SimpleNamespace(
        row={
            "joint_viscosity": SimpleNamespace(value=0.06),
            "muscle_viscosity": SimpleNamespace(value=12.0),
        },
        muscles=SimpleNamespace(muscles=tuple(muscles)),
    )
    dampers = Dampers(
        bushings=(),
        coordinates=FrozenMap({}),
        muscles=line_viscosity(muscles, lines),
        residual=0.0,
    )
    return _lines(report, dampers, "scapula to humerus")


def test_a_muscle_of_several_lines_shares_its_viscosity():
    lines = {"deltoid": ("delt1", "delt2", "delt3"), "pectoralis": ("pec1", "pec2")}
    joint, muscles = told(lines)
    assert joint == "scapula to humerus: 0.06 N m s/rad"
    assert muscles == ("2 muscles: 12 N s/m each, which its lines share: 5 of 4 to 6 N s/m")


def test_muscles_of_one_line_have_it_each():
    _, muscles = told({"deltoid": ("delt1",), "teres": ("teres",)})
    assert muscles == "2 muscles: 12 N s/m each"
