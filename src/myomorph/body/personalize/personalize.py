"""Muscles of a model fitted to a person.

From the generic model's operating ranges and from recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from myomorph.body.personalize.fibers import MuscleShapes, muscle_shapes, rigid_lengths
from myomorph.body.personalize.fit import Fitted, HeldOut, fit, held_out, path_ends, split
from myomorph.body.personalize.generic_map import GenericMap, map_generic
from myomorph.body.personalize.prior import Prior, PriorOptions, prior_of, with_sizes
from myomorph.body.personalize.recordings import PersonalTrial, Windows, torque_floors, windows_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, check_choices
from myomorph.core.model.model import Model

# Standard deviations on either side that hold 90 % of a normal distribution
NINETY = 1.6448536269514722
PARTLY = 0.5
WELL = 0.25
"""Greatest ratios of variances, after and before the recordings, at which a parameter is partly or
well identified.
"""
CLOSE = {"optimal_fiber_length": 0.05, "tendon_slack_length": 0.03}
"""Half width of the interval of an identifiable parameter, as a share of its value."""
OVERSTRETCHED = 1.8
_NORMAL = scipy.stats.norm.ppf(scipy.stats.qmc.Halton(2, scramble=False).random(2001)[1:])
"""Two independent normal numbers, spread evenly: for intervals of what is not linear in the
parameters.
"""
FIBER = "optimal_fiber_length"
SLACK = "tendon_slack_length"
FORCE = "strength"
STRAIN = "passive_strain"
GAIN = "emg_gain"


@dataclass(frozen=True)
class PersonalizeOptions(PriorOptions):
    """Settings of `personalize`; spreads are standard deviations between people.

    Attributes
    ----------
    tendons : "elastic": tendons stretch as their class has it; "rigid": they keep their slack
        length
    hold_out : whether the last recording, or the last third of a single one, is held out to check
        on
    keep_generic : whether groups of muscles keep generic values that explain what was held out
        better
    """

    tendons: Literal["elastic", "rigid"] = "elastic"
    hold_out: bool = True
    keep_generic: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choices(self)


@dataclass(frozen=True)
class MuscleEstimate:
    """One parameter of a person.

    Attributes
    ----------
    of : muscle, group of muscles, or muscles that share a channel of EMG
    parameter : "optimal_fiber_length", "tendon_slack_length" [m], "strength", "passive_strain" or
        "emg_gain" [1]
    generic : of the model that personalization began with; a factor's is 1
    person : estimated
    low, high : of the interval that holds it with 90 % probability
    variance_ratio : variance after the recordings over that before them, of lengths as of their
        logarithms
    identifiable : "yes": the recordings leave a quarter of the variance or less, and lengths are
        known to 5 % (fibers) and 3 % (slack); "partly": half of the variance or less; "no": it is
        mostly what was assumed before
    bound : "low" or "high" where it stands at the end of what is physiological, else ""
    kept : whether the generic value was kept because it explains the held-out recording better
    """

    of: str
    parameter: str
    generic: float
    person: float
    low: float
    high: float
    variance_ratio: float
    identifiable: Literal["yes", "partly", "no"]
    bound: str = ""
    kept: bool = False


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
    fitted : the estimate's own numbers; None without recordings
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
    fitted: Fitted | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
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
    mapped = None if generic is None else map_generic(generic, model)
    start = model if mapped is None else mapped.model
    notes: list[str] = [] if mapped is None else list(mapped.notes)
    if not trials:
        assert mapped is not None
        none = np.zeros((len(model.muscles), 2))
        return Personalized(
            model=start,
            estimates=_of_map(model, mapped),
            recordings=(),
            coordinates=(),
            mapped=mapped,
            held_out=None,
            before=none,
            after=none,
            torque_errors=np.zeros(0),
            frames=(0.0, 0),
            fitted=None,
            notes=tuple(notes),
        )
    shapes = muscle_shapes(start, options.tendons == "elastic")
    windows, rows = windows_of(start, trials)
    fixed, reach = _cannot_reach(start, shapes, windows)
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        prior = prior_of(start, shapes, windows, rows, options, fixed)
        floors = torque_floors(
            start, rows, [window for window in windows if np.isfinite(window.step)] or windows
        )
        seen, unseen = split(windows) if options.hold_out else (list(windows), [])
        fitted = fit(prior, shapes, seen, floors, advance=advance)
        checked = None
        p = fitted.p
        if unseen:
            checked, p = held_out(prior, shapes, seen, unseen, floors, fitted, options.keep_generic)
    sizes = prior.sizes(p)
    made = with_sizes(start, sizes, prior.start)
    estimates = _estimates(prior, fitted, p, () if checked is None else checked.kept)
    ends = path_ends(windows)
    before = rigid_lengths(shapes, prior.start, ends).T
    after = rigid_lengths(shapes, sizes, ends).T
    counted = sum(
        weight * recording.counted.sum()
        for weight, recording in zip(fitted.weights, seen, strict=True)
    )
    frames = (float(counted), sum(int(recording.counted.sum()) for recording in seen))
    worst = [f"{len(reach)} muscles cannot reach; {reach[0]}"] if len(reach) > 1 else reach
    notes = [*worst, *_notes(fitted, estimates, checked, options, seen), *notes, *reach[1:]]
    return Personalized(
        model=made,
        estimates=estimates,
        recordings=tuple(window.name for window in windows),
        coordinates=rows,
        mapped=mapped,
        held_out=checked,
        before=before,
        after=after,
        torque_errors=fitted.noise.torque,
        frames=frames,
        fitted=replace(fitted, p=p),
        notes=tuple(notes),
        strength_groups=tuple(prior.groups[number] for number in prior.group),
    )


def _cannot_reach(
    model: Model, shapes: MuscleShapes, windows: Sequence[Windows]
) -> tuple[np.ndarray, list[str]]:
    """Find muscles that are off, and report those whose path leaves their range.

    Returns
    -------
    (muscles,) whether the muscle is off and so keeps its lengths, and one line for each that cannot
        reach in some frames
    """
    fixed = np.array([not muscle.enabled for muscle in model.muscles], bool)
    notes = []
    lengths = np.concatenate([window.lengths[window.counted] for window in windows])
    time = np.concatenate([window.time[window.counted] for window in windows])
    where = [window.name for window in windows for _ in range(int(window.counted.sum()))]
    for m in np.flatnonzero(~fixed):
        muscle = model.muscles[m]
        fiber = muscle.optimal_fiber_length
        short = (muscle.tendon_slack_length - lengths[:, m]) / fiber
        excess = np.stack([short, -short - OVERSTRETCHED], axis=1)
        share = int((excess > 0.0).any(axis=1).sum())
        if share:
            frame, long = divmod(int(np.argmax(excess)), 2)
            worst = float(excess[frame, long])
            reason = (
                f"stretches it beyond {OVERSTRETCHED:g} optimal fiber lengths, to"
                f" {worst + OVERSTRETCHED:.2f}"
                if long
                else f"is shorter than its slack tendon by {1e3 * worst * fiber:.0f} mm"
            )
            notes.append(
                f"muscle '{muscle.name}' cannot reach in {share} of {len(time)} frames of the model"
                f" given: its path {reason} at {time[frame]:.2f} s of '{where[frame]}'"
            )
    return fixed, notes


def _of_map(model: Model, mapped: GenericMap) -> tuple[MuscleEstimate, ...]:
    """Lengths before and after a map, which says nothing of how sure they are."""
    results = []
    for muscle, other in zip(model.muscles, mapped.model.muscles, strict=True):
        for name in (FIBER, SLACK):
            value = float(getattr(other, name))
            results.append(
                MuscleEstimate(
                    of=muscle.name,
                    parameter=name,
                    generic=float(getattr(muscle, name)),
                    person=value,
                    low=np.nan,
                    high=np.nan,
                    variance_ratio=1.0,
                    identifiable="no",
                )
            )
    return tuple(results)


def _estimates(
    prior: Prior, fitted: Fitted, p: Array, kept: Sequence[str]
) -> tuple[MuscleEstimate, ...]:
    """List all parameters with their intervals.

    Parameters
    ----------
    p : (parameters,) that were chosen
    kept : groups that keep their generic values
    """
    sizes = prior.sizes(p)
    result = list[MuscleEstimate]()
    before = np.asarray(np.linalg.inv(prior.precision), dtype=np.float64)

    def add(
        row: Array,
        of: str,
        parameter: str,
        values: tuple[float, float],
        at: Sequence[int],
        kept: bool,
    ) -> None:
        """One parameter whose logarithm has the slopes `row` in p; `values` generic and now."""
        variance = float(row @ fitted.covariance @ row)
        first = float(row @ before @ row)
        free = bool(np.any(prior.deviation[list(at)] > 0.0)) and values[1] > 0.0
        ratio = min(variance / first, 1.0) if free else 1.0
        # Generic values that were kept are no surer than before the recordings.
        spread = NINETY * np.sqrt(first if kept else variance) if free else np.nan
        well = ratio <= WELL and spread <= CLOSE.get(parameter, np.inf)
        level: Literal["yes", "partly", "no"]
        if well:
            level = "yes"
        elif ratio <= PARTLY:
            level = "partly"
        else:
            level = "no"
        at_bound = [number for number in at if abs(p[number]) >= prior.bound[number] - 1e-9]
        if not at_bound:
            bound = ""
        elif p[at_bound[0]] > 0.0:
            bound = "high"
        else:
            bound = "low"
        low = values[1] * np.exp(-spread)
        high = values[1] * np.exp(spread)
        if parameter == SLACK and free:
            low, high = _slack_interval(prior, p, before if kept else fitted.covariance, at)
        result.append(
            MuscleEstimate(
                of=of,
                parameter=parameter,
                generic=float(values[0]),
                person=float(values[1]),
                low=float(low),
                high=float(high),
                variance_ratio=1.0 if kept else ratio,
                identifiable="no" if kept else level,
                bound=bound,
                kept=kept,
            )
        )

    _, point, force, strain, gain = prior.parts
    for m, name in enumerate(prior.names):
        group_kept = prior.groups[prior.group[m]] in kept
        lo = sizes.fiber[m]
        slack = sizes.slack[m]
        shift = point.start + m
        rows = np.zeros((2, len(p)))
        rows[0, m] = 1.0
        rows[1, [m, shift]] = -(prior.point[m] + p[shift]) * lo / slack, -lo / slack
        add(rows[0], name, FIBER, (prior.start.fiber[m], lo), (m,), group_kept)
        add(rows[1], name, SLACK, (prior.start.slack[m], slack), (m, shift), group_kept)
    shared = (
        (force, FORCE, prior.groups),
        (strain, STRAIN, prior.groups),
        (gain, GAIN, prior.gains),
    )
    for part, parameter, names in shared:
        for number, name in enumerate(names, part.start):
            values = (1.0, float(np.exp(p[number])))
            add(
                np.eye(len(p))[number],
                name,
                parameter,
                values,
                (number,),
                parameter != GAIN and name in kept,
            )
    return tuple(result)


def _slack_interval(
    prior: Prior, p: Array, covariance: Array, at: Sequence[int]
) -> tuple[float, float]:
    """Compute the ends of a slack length's interval.

    It is a product of two parameters, which of a short tendon is far from normal.

    Parameters
    ----------
    p : (parameters,)
    covariance : (parameters, parameters)
    at : numbers of the muscle's fiber and shift

    Returns
    -------
    ends of the 90 % interval [m]
    """
    m = at[0]
    spread = np.linalg.cholesky(covariance[np.ix_(at, at)] + 1e-14 * np.eye(2))
    fiber, point = p[list(at)][:, None] + spread @ _NORMAL.T
    slack = prior.reference[m] - (prior.point[m] + point) * prior.start.fiber[m] * np.exp(fiber)
    low, high = np.quantile(slack, (0.05, 0.95))
    return max(float(low), 0.0), float(high)


def known_by_prior(estimates: Sequence[MuscleEstimate]) -> str:
    """Report the share of lengths that only what was assumed before knows, in one line."""
    levels = {
        name: [estimate.identifiable for estimate in estimates if estimate.parameter == name]
        for name in (FIBER, SLACK)
    }
    every = [level for those in levels.values() for level in those]
    share = 100.0 * every.count("no") / max(len(every), 1)
    what = "; ".join(
        f"of {len(those)} {name.replace('_', ' ')}s they identify {those.count('yes')},"
        f" {those.count('partly')} partly"
        for name, those in levels.items()
    )
    before = f"{share:.0f} % of the lengths, which are what was assumed before"
    return f"the recordings say little or nothing of {before}: {what}"


def _notes(
    fitted: Fitted,
    estimates: Sequence[MuscleEstimate],
    checked: HeldOut | None,
    options: PersonalizeOptions,
    seen: Sequence[Windows],
) -> list[str]:
    """Report what may not be believed, worst first."""
    notes = [known_by_prior(estimates)]
    if checked is not None and checked.kept:
        what = ", ".join(checked.kept)
        notes.append(
            f"generic muscles explain {', '.join(checked.recordings)} better than fitted ones in"
            f" {len(checked.kept)} groups, which keep their generic values: {what}"
            if options.keep_generic
            else (
                f"generic muscles explain {', '.join(checked.recordings)} better than the fitted"
                f" ones: {what}"
            )
        )
    bounds = [
        f"{estimate.of} {estimate.parameter.replace('_', ' ')}"
        for estimate in estimates
        if estimate.bound
    ]
    if bounds:
        notes.append(
            f"{len(bounds)} parameters stand at a bound: {', '.join(bounds[:5])}"
            + (" ..." if bounds[5:] else "")
        )
    if fitted.moved > 0.5:
        notes.append(
            f"the fit was still moving after {fitted.steps} steps, by {fitted.moved:.2f} standard"
            " deviations"
        )
    if not any(np.isfinite(recording.emg).any() for recording in seen):
        notes.append(
            "no EMG: torques alone tell little of single muscles, see the column 'identifiable'"
        )
    if checked is None and options.hold_out:
        notes.append(
            "the recordings are too short to hold out a part: nothing shows that the muscles fit"
            " another motion"
        )
    return notes
