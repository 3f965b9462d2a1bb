"""The quantities that are held against limits: one identity each, whose value is what tables and pages print."""

from __future__ import annotations

from enum import StrEnum


class Quantity(StrEnum):
    """What a verdict is about; found by its member, never by the printed text."""

    MARKER_RMS = "Marker error, RMS of the worst frame"
    MARKER_LARGEST = "Marker error, largest"
    MARKER_GAPS = "Gaps in the markers"
    NOT_CONVERGED = "Frames whose inverse kinematics did not converge"
    LOOP_CLOSURE = "Loop-closure error"
    OUT_OF_RANGE = "Coordinates outside the model's range"
    RESIDUAL_FORCE_PEAK = "Residual force, peak"
    RESIDUAL_FORCE_RMS = "Residual force, RMS"
    RESIDUAL_MOMENT_PEAK = "Residual moment, peak"
    RESIDUAL_MOMENT_RMS = "Residual moment, RMS"
    CONTACT_FORCE_PEAK = "Residual force beside contacts, peak"
    CONTACT_FORCE_RMS = "Residual force beside contacts, RMS"
    CONTACT_MOMENT_PEAK = "Residual moment beside contacts, peak"
    CONTACT_MOMENT_RMS = "Residual moment beside contacts, RMS"
    INFEASIBLE_CONTACT = "Infeasible contact frames"
    NOT_OPTIMAL = "Frames without an optimal muscle solution"
    RESERVES = "Reserve actuators, largest"
    UNDRIVEN = "Coordinates that no muscle moves"
    OVERSTRETCHED = "Overstretched muscles"
    SATURATED = "Saturated muscles"

    @staticmethod
    def residual(what: str, statistic: str, contacts: bool = False) -> Quantity:
        """Residual "force" or "moment", its "peak" or "RMS"; with contacts, what is left beside estimated ones."""
        return Quantity[f"{'CONTACT' if contacts else 'RESIDUAL'}_{what.upper()}_{statistic.upper()}"]
