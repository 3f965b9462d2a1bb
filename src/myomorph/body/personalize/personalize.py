"""Muscles of a model fitted to a person.

From the generic model's operating ranges and from recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.causes import HELD_OUT, PERSONAL_MUSCLES, SEARCH
from myomorph.body.personalize.estimates import (
    Knowledge,
    MuscleEstimate,
    estimates_of,
    known_by_prior,
    mapped_estimates,
)
from myomorph.body.personalize.fibers import rigid_lengths
from myomorph.body.personalize.fit import Fitted, fit
from myomorph.body.personalize.generic_map import GenericMap, map_generic
from myomorph.body.personalize.held_out import HeldOut, held_out, split
from myomorph.body.personalize.muscle_curves import muscle_shapes
from myomorph.body.personalize.muscle_problem import BLOCKS, MuscleProblem
from myomorph.body.personalize.prior import PriorOptions, prior_of, with_sizes
from myomorph.body.personalize.reach import cannot_reach
from myomorph.body.personalize.recordings import PersonalTrial, Windows, torque_floors, windows_of
from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import MUSCLES
from myomorph.core.model.errors import BadData, BadModel, check_choices, check_name, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.paths import impossible_fibers

STILL_MOVING = 0.5  # Last step in standard deviations from which on a fit is reported as unfinished
MAX_SHOWN = 5  # Parameters at a bound that are named


@dataclass(frozen=True)
class PersonalizeOptions(PriorOptions):
    """Settings of `personalize`; spreads are standard deviations between people.

    Attributes
    ----------
    fit : parameters that are estimated together: "fibers" (optimal fiber lengths), "points"
        (operating points, which determine tendon slack lengths), "strength", "passive", "gains";
        others keep their given values
    tendons : tendon model; "elastic": tendons stretch by the curves of their class; "rigid": they
        keep their slack length
    hold_out : hold out the last recording, or the last third of a single one, to check the result
    keep_generic : let groups of muscles keep generic values that explain held-out recordings better
    """

    fit: tuple[str, ...] = BLOCKS
    tendons: Literal["elastic", "rigid"] = "elastic"
    hold_out: bool = True
    keep_generic: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choices(self)
        for name in self.fit:
            check_name("parameters", name, BLOCKS, "what can be fitted to a person")
        if not self.fit:
            raise BadData(f"nothing to fit; expected some of {', '.join(BLOCKS)}")


@read_only
class Personalized:
    """A model with a person's muscles, and how sure they are.

    Attributes
    ----------
    model : with the person's muscles
    estimates : every parameter
    recordings : names
    coordinates : whose torques were compared
    mapped : of the generic model, None where none was given
    held_out : None where nothing was
    before, after : (muscles, 2) least and greatest normalized fiber lengths of the recordings,
        tendons at slack length
    torque_errors : (coordinates,) standard deviation of the torques' errors that the misfits show
        [N m or N]
    frames : that count, of so many as were fitted to
    estimate : the fit itself with what certifies it: covariance, misfit of each recording, how the
        search ended, its verdict; None without recordings. Groups that keep their generic values
        are fitted in it
    strength_groups : of each muscle, the group whose strength it shares; () without recordings
    notes : what may not be believed, one line each, worst first
    """

    model: Model
    estimates: tuple[MuscleEstimate, ...]
    recordings: tuple[str, ...]
    coordinates: tuple[str, ...]
    mapped: GenericMap | None
    held_out: HeldOut | None
    before: Array
    after: Array
    torque_errors: Array
    frames: tuple[float, int]
    estimate: Estimate | None = None
    notes: tuple[Message, ...] = field(default_factory=tuple)
    strength_groups: tuple[str, ...] = ()


def personalize(
    model: Model,
    trials: Sequence[PersonalTrial] = (),
    options: PersonalizeOptions | None = None,
    *,
    generic: Model | None = None,
    advance: Callable[[int], None] | None = None,
) -> Personalized:
    """Fit muscle parameters to a person: fibers, tendons, strengths and passive strains.

    With a generic model, muscles are first given the lengths at which they work where the generic
    model's do (`map_generic`). Recordings then move them, as far as torques that have to be borne
    ask for it (see `fit`): what they do not show keeps its value, and every parameter says how much
    they showed.

    Sources: Modenese et al. 2016 for the map; Lloyd and Besier 2003, Pizzolato et al. 2015 for
    muscles from torques and EMG.

    Parameters
    ----------
    model : scaled to the person
    trials : recordings, at least one or a generic model
    options : settings; None for defaults
    generic : the model that was scaled
    advance : called with the number of steps just done

    Returns
    -------
    the model with the person's muscles, every parameter with its interval, and how held-out
        recordings are explained

    Raises
    ------
    BadData : without a recording or a generic model, or where a motion has no velocities
    BadModel : for muscles of a class whose curves are not known

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> found = mm.personalize(model, generic=model)
    >>> [round(one.optimal_fiber_length, 3) for one in found.model.muscles]
    [0.12, 0.12]
    """
    options = options or PersonalizeOptions()
    if not trials and generic is None:
        raise BadData(
            "nothing to fit muscles to: give a motion with torques, a generic model, or both"
        )
    if impossible := impossible_fibers(model.muscles):
        raise BadModel(
            f"{len(impossible)} muscles have impossible fibers ({quoted(impossible, 3)}:"
            " longer than the muscle, or a tendon shorter than 0), so there is nothing to"
            " personalize: use a model whose fibers were measured"
        )
    mapped = None if generic is None else map_generic(generic, model)
    if not trials:
        assert mapped is not None
        return _only_mapped(model, mapped)
    start = model if mapped is None else mapped.model
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        return _fitted(start, trials, options, mapped, advance)


def _only_mapped(model: Model, mapped: GenericMap) -> Personalized:
    """Report a map alone."""
    none = np.zeros((len(model.muscles), 2))
    return Personalized(
        model=mapped.model,
        estimates=mapped_estimates(model, mapped),
        recordings=(),
        coordinates=(),
        mapped=mapped,
        held_out=None,
        before=none,
        after=none,
        torque_errors=np.zeros(0),
        frames=(0.0, 0),
        notes=mapped.notes,
    )


def _fitted(
    start: Model,
    trials: Sequence[PersonalTrial],
    options: PersonalizeOptions,
    mapped: GenericMap | None,
    advance: Callable[[int], None] | None,
) -> Personalized:
    """Fit to recordings, and check on what was held out."""
    windows, rows = windows_of(start, trials)
    every = _problem(start, windows, rows, options)
    parts = split(windows) if options.hold_out else None
    seen = every if parts is None else every.of(parts.seen)
    fitted = fit(seen, options.fit, advance=advance)
    p = fitted.p
    checked = None
    if parts is not None and parts.unseen:
        checked, p = held_out(seen, parts.unseen, fitted, options.keep_generic)
    prior = every.prior
    kept = () if checked is None else checked.kept
    estimates = estimates_of(Knowledge.of(prior, fitted.posterior, p, kept))
    result = _Result(fitted=fitted, estimates=estimates, checked=checked, seen=seen.windows)
    sizes = prior.sizes(p)
    ends = every.path_ends()
    return Personalized(
        model=with_sizes(start, sizes, prior.start),
        estimates=estimates,
        recordings=tuple(window.name for window in windows),
        coordinates=rows,
        mapped=mapped,
        held_out=checked,
        before=rigid_lengths(every.shapes, prior.start, ends).T,
        after=rigid_lengths(every.shapes, sizes, ends).T,
        torque_errors=fitted.noise.torque,
        frames=_frames(result),
        estimate=estimate_of(
            fitted.solution,
            posterior=fitted.posterior,
            verdict=None if checked is None else checked.verdict,
        ),
        notes=_all_notes(cannot_reach(start, windows), result, options, mapped),
        strength_groups=tuple(prior.groups[number] for number in prior.group),
    )


def _problem(
    start: Model, windows: Sequence[Windows], rows: Sequence[str], options: PersonalizeOptions
) -> MuscleProblem:
    """State what is known before the fit, from all recordings.

    Parameters
    ----------
    start : model that personalization begins with
    windows : recordings
    rows : names of the coordinates that are compared
    options : spreads between people
    """
    fixed = np.array([not muscle.enabled for muscle in start.muscles], bool)
    moving = [window for window in windows if not window.at_rest]
    return MuscleProblem(
        prior=prior_of(start, windows, rows, options, fixed),
        shapes=muscle_shapes(start, options.tendons == "elastic"),
        windows=tuple(windows),
        floors=torque_floors(start, rows, moving or windows),
    )


class _Result(NamedTuple):
    """What a fit gave: parameters, how they explain what was held out, and what was fitted to."""

    fitted: Fitted
    estimates: tuple[MuscleEstimate, ...]
    checked: HeldOut | None
    seen: tuple[Windows, ...]


def _frames(result: _Result) -> tuple[float, int]:
    """Count independent frames, of so many as were fitted to."""
    counts = [int(window.counted.sum()) for window in result.seen]
    independent = sum(
        weight * count for weight, count in zip(result.fitted.weights, counts, strict=True)
    )
    return float(independent), sum(counts)


def _all_notes(
    reach: Sequence[Message],
    result: _Result,
    options: PersonalizeOptions,
    mapped: GenericMap | None,
) -> tuple[Message, ...]:
    """Report what may not be believed, worst first.

    Parameters
    ----------
    reach : muscles that cannot reach, one line each
    result : of the fit
    options : of the fit
    mapped : with muscles that could not be mapped
    """
    worst = list(reach[:1])
    if len(reach) > 1:
        worst = [MUSCLES.message(f"{len(reach)} muscles cannot reach; {reach[0]}")]
    of_map = () if mapped is None else mapped.notes
    return (*worst, *_notes(result, options), *of_map, *reach[1:])


def _notes(result: _Result, options: PersonalizeOptions) -> list[Message]:
    """Report what may not be believed of the fit."""
    checked = result.checked
    notes = [known_by_prior(result.estimates), *_kept_note(checked, options)]
    bounds = [
        f"{estimate.of} {estimate.parameter.replace('_', ' ')}"
        for estimate in result.estimates
        if estimate.bound
    ]
    if bounds:
        more = " ..." if len(bounds) > MAX_SHOWN else ""
        shown = ", ".join(bounds[:MAX_SHOWN])
        notes.append(
            PERSONAL_MUSCLES.message(f"{len(bounds)} parameters are at a bound: {shown}{more}")
        )
    search = result.fitted.solution.search
    if search.change > STILL_MOVING:
        notes.append(
            SEARCH.message(
                f"the fit had not converged after {search.steps + 1} steps, by {search.change:.2f}"
                " standard deviations"
            )
        )
    if not any(np.isfinite(window.emg).any() for window in result.seen):
        notes.append(
            PERSONAL_MUSCLES.message(
                "no EMG: torques alone determine little of single muscles, see the column"
                " 'identifiable'"
            )
        )
    if checked is None and options.hold_out:
        notes.append(
            HELD_OUT.message(
                "the recordings are too short to hold out a part: whether the muscles fit another"
                " motion is unknown"
            )
        )
    return notes


def _kept_note(checked: HeldOut | None, options: PersonalizeOptions) -> list[Message]:
    """Name the groups whose generic values explain what was held out better."""
    if checked is None or not checked.kept:
        return []
    kept = ", ".join(checked.kept)
    explained = f"generic muscles explain {', '.join(checked.recordings)} better than"
    if options.keep_generic:
        groups = f"{len(checked.kept)} groups, which keep their generic values"
        return [HELD_OUT.message(f"{explained} fitted ones in {groups}: {kept}")]
    return [HELD_OUT.message(f"{explained} the fitted ones: {kept}")]
