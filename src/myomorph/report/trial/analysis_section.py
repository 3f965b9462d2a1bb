"""The sections that tell a motion as chapter 5 of [D] tells those of experts."""

from __future__ import annotations

from myomorph.report.charts.tracks import Backdrop
from myomorph.report.page.section import Section
from myomorph.report.trial.center_section import center_section
from myomorph.report.trial.contact_panel import contact_force_section
from myomorph.report.trial.motion_analysis import MotionAnalysis, analyse
from myomorph.report.trial.prepared import Prepared
from myomorph.report.trial.relation_tables import phase_section, relation_section
from myomorph.report.trial.score_section import score_section

LONGEST_SCORE = 120.0
MOST_STRIPES = 60


def analysis_sections(prepared: Prepared) -> list[Section]:
    """The panels of the motion's preset that what was given allows."""
    analysis = analyse(prepared)
    if analysis is None:
        return []
    behind = _backdrop(prepared, analysis)
    found: list[Section | None] = []
    for panel in analysis.preset.panels:
        if panel == "score":
            found.append(score_section(prepared, analysis, behind))
        elif panel == "center":
            found.append(center_section(prepared, analysis, behind))
        elif panel == "phases":
            found.append(phase_section(analysis))
        elif panel == "contact forces":
            found.append(contact_force_section(prepared, behind, analysis.who))
        else:
            found.append(relation_section(analysis))
    return [one for one in found if one is not None]


def _backdrop(prepared: Prepared, analysis: MotionAnalysis) -> Backdrop:
    """The whole motion, or of a very long one the part that other charts show."""
    long = prepared.span[1] - prepared.span[0] > LONGEST_SCORE
    span = prepared.detail if long else prepared.span
    phases = tuple(one for one in analysis.cutting.phases if one.stop > span[0] and one.start < span[1])
    events = prepared.events if analysis.cutting.by in ("events", "given") else ()
    return Backdrop(span, phases if len(phases) <= MOST_STRIPES else (), events)
