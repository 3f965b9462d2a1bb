"""Parameters of a person with their intervals, and what the recordings showed of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from myomorph.body.causes import PERSONAL_MUSCLES
from myomorph.body.personalize.generic_map import GenericMap
from myomorph.body.personalize.prior import Prior
from myomorph.core.fit.interval_rule import drawn_limits, half_width
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model

PARTLY = 0.5
WELL = 0.25
"""Greatest ratios of variances, after and before the recordings, at which a parameter is partly or
well identified.
"""
CLOSE = {"optimal_fiber_length": 0.05, "tendon_slack_length": 0.03}
"""Half width of the interval of an identifiable parameter, as a share of its value."""
FIBER = "optimal_fiber_length"
SLACK = "tendon_slack_length"
FORCE = "strength"
STRAIN = "passive_strain"
GAIN = "emg_gain"

Level = Literal["yes", "partly", "no"]


@dataclass(frozen=True, kw_only=True)
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
    identifiable: Level
    bound: str = ""
    kept: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Knowledge:
    """What is known of the parameters.

    Attributes
    ----------
    prior : of the parameters
    before, after : about the parameters that were chosen, without and with the recordings
    kept : groups that keep their generic values
    """

    prior: Prior
    before: Posterior
    after: Posterior
    kept: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, prior: Prior, posterior: Posterior, p: Array, kept: tuple[str, ...] = ()
    ) -> Knowledge:
        """Put what was known before beside what is known after a fit.

        Parameters
        ----------
        prior : of the parameters
        posterior : of the fit
        p : (parameters,) that were chosen
        kept : groups that keep their generic values

        Returns
        -------
        both about the parameters that were chosen
        """
        after = replace(posterior, x=p)
        inner = np.ix_(after.free, after.free)
        covariance = np.zeros_like(prior.precision)
        covariance[inner] = np.linalg.inv(prior.precision[inner])
        return cls(
            prior=prior, before=replace(after, covariance=covariance), after=after, kept=kept
        )

    @property
    def p(self) -> Array:
        """(parameters,) that were chosen."""
        return self.after.x

    @property
    def free(self) -> Bools:
        """(parameters,) which were estimated."""
        return self.after.free

    def posterior(self, kept: bool) -> Posterior:
        """Return what is known of a number; of a generic value that was kept, what was before."""
        return self.before if kept else self.after


class _Reported(NamedTuple):
    """A number of a person.

    Attributes
    ----------
    of, parameter, generic, person : see `MuscleEstimate`
    slopes : (parameters,) of its logarithm
    of_parameters : numbers of the parameters that it depends on
    kept : whether it is the generic value that explains what was held out better
    draws : (draws,) from what is known, of a number that is not linear in the parameters and whose
        logarithm is not either; None of others
    """

    of: str
    parameter: str
    generic: float
    person: float
    slopes: Array
    of_parameters: tuple[int, ...]
    kept: bool
    draws: Array | None = None


def estimates_of(known: Knowledge) -> tuple[MuscleEstimate, ...]:
    """List all parameters with their intervals.

    Parameters
    ----------
    known : of the parameters

    Returns
    -------
    lengths of each muscle, then strengths, passive strains and gains
    """
    reported = [*_lengths(known), *_factors(known)]
    return tuple(_estimate(known, number) for number in reported)


def _lengths(known: Knowledge) -> Iterator[_Reported]:
    """List fiber and slack lengths of each muscle.

    With lo = lo_0 exp(p_fiber) and ls = L - (point + p_point) lo,

        d log ls = -(point + p_point) lo / ls dp_fiber - lo / ls dp_point

    A slack length is a product of two parameters, which of a short tendon is far from normal: it is
    drawn.
    """
    prior = known.prior
    drawn = {kept: _drawn_slack(known, kept) for kept in {False, bool(known.kept)}}
    parts = prior.parts
    sizes = prior.sizes(known.p)
    for m, name in enumerate(prior.names):
        kept = prior.groups[prior.group[m]] in known.kept
        fiber = parts.fibers.start + m
        point = parts.points.start + m
        lo = sizes.fiber[m]
        slack = sizes.slack[m]
        of_fiber = np.zeros(len(known.p))
        of_fiber[fiber] = 1.0
        of_slack = np.zeros(len(known.p))
        of_slack[fiber] = -(prior.point[m] + known.p[point]) * lo / slack
        of_slack[point] = -lo / slack
        yield _Reported(
            of=name,
            parameter=FIBER,
            generic=float(prior.start.fiber[m]),
            person=float(lo),
            slopes=of_fiber,
            of_parameters=(fiber,),
            kept=kept,
        )
        yield _Reported(
            of=name,
            parameter=SLACK,
            generic=float(prior.start.slack[m]),
            person=float(slack),
            slopes=of_slack,
            of_parameters=(fiber, point),
            kept=kept,
            draws=drawn[kept][:, m],
        )


def _factors(known: Knowledge) -> Iterator[_Reported]:
    """List strengths and passive strains of groups, and gains of EMG."""
    prior = known.prior
    parts = prior.parts
    kinds = (
        (parts.strength, FORCE, prior.groups),
        (parts.passive, STRAIN, prior.groups),
        (parts.gains, GAIN, prior.gains),
    )
    for part, parameter, names in kinds:
        for index, name in enumerate(names, part.start):
            yield _Reported(
                of=name,
                parameter=parameter,
                generic=1.0,
                person=float(np.exp(known.p[index])),
                slopes=np.eye(len(known.p))[index],
                of_parameters=(index,),
                kept=parameter != GAIN and name in known.kept,
            )


def _estimate(known: Knowledge, number: _Reported) -> MuscleEstimate:
    """Give a number its interval, and say what the recordings showed of it."""
    slopes = number.slopes
    free = bool(known.free[list(number.of_parameters)].any()) and number.person > 0.0
    ratio = 1.0
    spread = np.nan
    if free:
        variance = slopes @ known.after.covariance @ slopes
        ratio = min(float(variance / (slopes @ known.before.covariance @ slopes)), 1.0)
        # Generic values that were kept are no surer than before the recordings.
        covariance = known.posterior(number.kept).covariance
        spread = float(half_width(np.sqrt(slopes @ covariance @ slopes)))
    low = number.person * float(np.exp(-spread))
    high = number.person * float(np.exp(spread))
    if number.draws is not None and free:
        lower, upper = drawn_limits(number.draws, value=number.person)
        low = max(float(lower), 0.0)
        high = float(upper)
    return MuscleEstimate(
        of=number.of,
        parameter=number.parameter,
        generic=number.generic,
        person=number.person,
        low=low,
        high=high,
        variance_ratio=1.0 if number.kept else ratio,
        identifiable="no" if number.kept else _level(number.parameter, ratio, spread),
        bound=_bound(known, number.of_parameters),
        kept=number.kept,
    )


def _level(parameter: str, ratio: float, spread: float) -> Level:
    """Judge a parameter by its ratio of variances and the half width of its log's interval."""
    if ratio <= WELL and spread <= CLOSE.get(parameter, np.inf):
        return "yes"
    return "partly" if ratio <= PARTLY else "no"


def _bound(known: Knowledge, index: Sequence[int]) -> str:
    """Tell at which bound the first of some parameters stands that is at one."""
    for number in index:
        value = float(known.p[number])
        if abs(value) >= known.prior.bound[number] - 1e-9:
            return "high" if value > 0.0 else "low"
    return ""


def _drawn_slack(known: Knowledge, kept: bool) -> Array:
    """Draw slack lengths of all muscles.

    Parameters
    ----------
    known : of the parameters
    kept : whether generic values were kept, so that what is known is what was before

    Returns
    -------
    (draws, muscles) [m]
    """
    prior = known.prior
    draws = known.posterior(kept).draws()
    lo = prior.start.fiber * np.exp(draws[:, prior.parts.fibers])
    return np.asarray(prior.reference - (prior.point + draws[:, prior.parts.points]) * lo)


def mapped_estimates(model: Model, mapped: GenericMap) -> tuple[MuscleEstimate, ...]:
    """List lengths before and after a map, which says nothing of how sure they are.

    Parameters
    ----------
    model : before the map
    mapped : the map
    """
    return tuple(
        MuscleEstimate(
            of=muscle.name,
            parameter=name,
            generic=float(getattr(muscle, name)),
            person=float(getattr(other, name)),
            low=np.nan,
            high=np.nan,
            variance_ratio=1.0,
            identifiable="no",
        )
        for muscle, other in zip(model.muscles, mapped.model.muscles, strict=True)
        for name in (FIBER, SLACK)
    )


def known_by_prior(estimates: Sequence[MuscleEstimate]) -> Message:
    """Report the share of lengths that only what was assumed before knows, in one line."""
    levels = {
        name: [estimate.identifiable for estimate in estimates if estimate.parameter == name]
        for name in (FIBER, SLACK)
    }
    every = [*levels[FIBER], *levels[SLACK]]
    share = 100.0 * every.count("no") / max(len(every), 1)
    what = "; ".join(
        f"of {len(those)} {name.replace('_', ' ')}s they identify {those.count('yes')},"
        f" {those.count('partly')} partly"
        for name, those in levels.items()
    )
    before = f"{share:.0f} % of the lengths, which follow the prior"
    return PERSONAL_MUSCLES.message(
        f"the recordings hardly determine {before}: {what}", severity="good to know"
    )
