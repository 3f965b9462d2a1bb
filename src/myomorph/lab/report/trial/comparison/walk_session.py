"""A session of walking: all strides of a person on a day, or with an orthosis, as one."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.core.model.arrays import read_only
from myomorph.lab.analysis.gait_curves import GaitCurves
from myomorph.lab.analysis.gait_parameters import ParameterTable
from myomorph.lab.report.trial.answer.judgement import Use


@read_only
class WalkSession:
    """What is compared.

    Attributes
    ----------
    name : of the session, in print
    facts : who was recorded, when, and in which trials
    curves : of both sides over all strides
    parameters : spatio-temporal ones, over all strides
    use : what the verdicts on all its trials allow
    """

    name: str
    facts: Mapping[str, str]
    curves: GaitCurves
    parameters: ParameterTable
    use: Use
