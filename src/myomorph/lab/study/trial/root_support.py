"""Whether known forces carry the body: what is left at the root holds it from nowhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.contact.found_supports import find_supports
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.supports import Supports
from myomorph.core.contact.undetermined import UNDETERMINED
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import FEET_BESIDE
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.findings import Span, spans_of, times_text
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of, segments_of
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.kinematics import body_motion
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.selection import root_coordinates
from myomorph.lab.report.trial.summary_lines import plain
from myomorph.lab.study.inputs.contacts import NothingTouches
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.trial.trial_inputs import JoinedParts, TrialInputs

MAX_LEFT = 0.1
"""Share of the weight at the root, on the median, from which on forces are missing."""
MIN_CARRIED = 0.7
"""Share of what a body needs that forces carry throughout if the model's mass alone is wrong."""


@read_only
class RootSupport:
    """What known forces leave of the body's weight at its root.

    Attributes
    ----------
    time : (frames,) whose pose is known [s]
    left : (frames,) upward force that is left over the weight
    weight : of the body [N]
    place : body of the root
    mass : of the body [kg]
    """

    time: Array
    left: Array
    weight: float
    place: str
    mass: float

    @property
    def median(self) -> float:
        """Share of the weight that is left in half of the frames."""
        return float(np.median(self.left))

    @property
    def frames(self) -> int:
        """Number of frames in which more than `MAX_LEFT` is left."""
        return int((self.left > MAX_LEFT).sum())

    @property
    def missing(self) -> tuple[Span, ...]:
        """Times at which more than `MAX_LEFT` is left [s]."""
        return spans_of(self.time, self.left > MAX_LEFT)

    @property
    def carried(self) -> Span | None:
        """Longest time for which no more than `MAX_LEFT` is left [s]; None for none."""
        spans = spans_of(self.time, self.left <= MAX_LEFT)
        return max(spans, key=lambda span: span[1] - span[0], default=None)

    @property
    def sentence(self) -> str:
        """How much is left, and in which frames."""
        return (
            f"{100.0 * self.median:.0f} % of the weight of {plain(self.weight)} N on the median,"
            f" more than {100.0 * MAX_LEFT:.0f} % in {self.frames} of {len(self.left)} frames"
            f" ({times_text(self.missing)})"
        )


def lacking_support(model: Model, motion: Motion, wrenches: Wrenches | None) -> RootSupport | None:
    """Find whether forces that are said to be known leave the body without support.

    They are said to be known where one is measured on a foot. A body whose mass is wrong is
    carried throughout, by the same share of what it needs.

    Parameters
    ----------
    model : of the body
    motion : with rates
    wrenches : known external forces at the same times, None for none

    Returns
    -------
    None where forces carry the body, or nobody said that they do
    """
    root = [name for names in root_coordinates(model) for name in names]
    if not root or not _is_measured(model, wrenches):
        return None
    assert wrenches is not None
    on_bodies = [body in model.body_names for body in wrenches.bodies]
    measured = np.nan_to_num(wrenches.forces[:, on_bodies]).sum(axis=1) @ model.up / model.weight
    needed = _needed(model, motion)
    known = np.isfinite(needed)
    left = (needed - measured)[known]
    if (
        not known.any()
        or np.median(left) <= MAX_LEFT
        or _is_carried(measured[known], needed[known])
    ):
        return None
    return RootSupport(
        time=motion.time[known],
        left=left,
        weight=model.weight,
        place=next(joint.child for joint in model.joints if root[-1] in joint.coordinates),
        mass=model.mass,
    )


def _is_measured(model: Model, wrenches: Wrenches | None) -> bool:
    """Tell whether a force on a foot of a body that floats and has weight is known."""
    floats = any(root_coordinates(model))
    if wrenches is None or not model.weight > 0.0 or not floats:
        return False
    segments = segments_of(model)
    loaded = set(wrenches.bodies) & set(model.body_names)
    return any(body in feet_of(model) or segments[body].name == "foot" for body in loaded)


def _needed(model: Model, motion: Motion) -> Array:
    """Upward force that the motion needs over the weight (frames,), NaN in gaps."""
    tree = compile_tree(model)
    numbers = np.arange(1, len(model.bodies) + 1, dtype=np.int64)
    mass = np.array([body.mass for body in model.bodies])
    centers = np.array([body.mass_center for body in model.bodies])
    moving = body_motion(tree, *motion_arrays(tree, motion)).of_points(numbers, centers)
    forces = np.einsum("b,fbi->fi", mass, moving.accelerations - np.array(model.gravity))
    return np.asarray(forces @ model.up / model.weight)


def _is_carried(measured: Array, needed: Array) -> bool:
    """Tell whether forces carry the same share of what is needed in most frames.

    Parameters
    ----------
    measured, needed : (frames,) forces over the weight
    """
    share = float(measured @ needed / max(float(needed @ needed), 1e-12))
    return share > MIN_CARRIED and float(np.median(np.abs(measured - share * needed))) <= MAX_LEFT


@dataclass(frozen=True, eq=False)
class Supported:
    """A trial whose contacts are those of the feet where plates leave them out.

    Attributes
    ----------
    trial : with contacts, where they were missing
    notes : on contacts that nobody asked for
    """

    trial: TrialInputs
    notes: tuple[Message, ...] = ()


def with_default_contacts(
    trial: TrialInputs, motion: Motion, wrenches: Wrenches | None
) -> Supported:
    """Estimate forces off the plates where measured ones do not carry the body.

    They act under the feet, and where `find_supports` finds steps, rails and seats. Where plates
    carry the body but for some time, nothing but these is estimated.

    Parameters
    ----------
    trial : as it was given
    motion : with rates
    wrenches : measured forces at the same times, None for none

    Returns
    -------
    the trial as it is where contacts are named, or forces carry the body

    Raises
    ------
    BadData : forces do not carry the body, and the model has no feet with places to touch
    """
    plan = trial.get(ContactPlan)
    if not _is_open(trial, plan):
        return Supported(trial)
    support = lacking_support(trial.model, motion, wrenches)
    supports = Supports()
    if _is_measured(trial.model, wrenches):
        supports = find_supports(trial.model, motion, wrenches)
    if support is None:
        if plan is not None or not supports:
            return Supported(trial)
        # Plates carry the body but for some time: nothing else changes.
        return Supported(trial.having(ContactPlan(supports=replace(supports, alone=True))))
    seats = any(item.kind == "seat" for item in supports.all)
    if plan is not None and not seats:
        return Supported(trial)
    try:
        foot_sites(trial.model)
    except MyomorphError as error:
        raise BadData(
            f"{_refusal(support, 'forces')}; contacts cannot be estimated: {error}"
        ) from None
    where = "a seat and feet" if seats else "feet"
    note = FEET_BESIDE.message(
        f"measured forces leave {support.sentence}: forces under {where} off the plates are"
        " estimated from the motion (--contacts none: the missing force stays at the root)",
        size=100.0 * support.frames / len(support.left),
        times=support.missing,
    )
    if plan is None:
        shared = _are_shared(trial, wrenches)
        plan = ContactPlan(measured="shared" if shared else "exact")
    return Supported(trial.having(replace(plan, supports=supports)), (note,))


def _is_open(trial: TrialInputs, plan: ContactPlan | None) -> bool:
    """Tell whether nobody named the contacts, and no other body carries this one."""
    if trial.get(NothingTouches) is not None or trial.get(JoinedParts) is not None:
        return False
    if plan is None:
        return True
    named = plan.sites or plan.reported or plan.sound or plan.stairs or not plan.feet
    return not named and plan.measured != "hidden"


def _are_shared(trial: TrialInputs, wrenches: Wrenches | None) -> bool:
    """Tell whether a plate's force is nobody's alone, and was put on the nearest foot."""
    loads = trial.get(ExternalLoads)
    if loads is None or wrenches is None or not loads.nearest:
        return False
    return any(finding.kind == UNDETERMINED for finding in wrenches.findings)


def refuse_missing_support(trial: TrialInputs, motion: Motion, loads: Wrenches) -> None:
    """Refuse tensions of a body that neither measured nor estimated forces carry.

    Parameters
    ----------
    trial : with contacts
    motion : with rates
    loads : all external forces, measured and estimated

    Raises
    ------
    BadData : more than `MAX_LEFT` of the weight is left at the root on the median
    """
    plan = trial.get(ContactPlan)
    measured = trial.get(ExternalLoads)
    if plan is None or measured is None or plan.measured == "hidden":
        return
    if trial.get(JoinedParts) is not None:
        return
    support = lacking_support(trial.model, motion, loads)
    if support is not None:
        raise BadData(_refusal(support, "measured forces and those estimated under the feet"))


def _refusal(support: RootSupport, what: str) -> str:
    """Say what is missing, and what to try."""
    part = support.carried
    span = "" if part is None else f", as {part[0]:.2f} {part[1]:.2f}"
    return (
        f"{what} do not support the body of {plain(support.mass)} kg: {support.sentence} would be"
        f" unexplained at '{support.place}'; name what else supports it, as forelimbs, hands or a"
        f" seat (--contacts FILE.toml), take a part on plates (--time START END{span}), or leave it"
        " there (--contacts none): then only tensions of limbs with a known load are meaningful"
    )
