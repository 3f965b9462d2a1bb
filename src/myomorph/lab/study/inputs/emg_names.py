"""Muscles that an EMG channel was measured on, by its name.

The spellings are those of laboratories and of models.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from myomorph.core.model.model import Model
from myomorph.core.model.sides import split_side

GLUTEUS_MAXIMUS = r"gl(ut(eus)?)?_?max(imus)?[\d_]*"
GLUTEUS_MEDIUS = r"gl(ut(eus)?)?_?med(ius)?[\d_]*"
BICEPS_LONG = r"(bi?f_?(em)?_?lh|bicfem|bifemlh|bflh|hamstrings|biceps_?fem(oris)?(_?lh)?)\d*"
SEMITENDINOSUS = r"semi_?ten(dinosus)?"
SEMIMEMBRANOSUS = r"semi_?mem(branosus)?"
MEDIAL_GASTROCNEMIUS = r"(gas_?med|med_?gas|gastroc(nemius)?)\d*"
LATERAL_GASTROCNEMIUS = r"(gas_?lat|lat_?gas)\d*"
SPELLINGS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"g(lut(eus)?)?_?max(imus)?|gm(a|ax)", (GLUTEUS_MAXIMUS,)),
    (r"g(lut(eus)?)?_?med(ius)?|gme(d)?", (GLUTEUS_MEDIUS,)),
    (r"add(uctor)?_?mag(nus)?", (r"add_?mag(dist|isch|mid|prox)?[\d_]*",)),
    (r"add(uctor)?_?long(us)?|al", (r"add_?long\w*",)),
    (r"grac(ilis)?", (r"grac\w*",)),
    (r"sar(t(orius)?)?", (r"sart?\w*",)),
    (r"tfl|tensor_?fasc(iae?)?(_?lat(ae)?)?", (r"tfl\w*",)),
    (r"rect?(us)?(_?fem(oris)?)?|rf", (r"(rec(t(us)?)?_?fem(oris)?\d*|rf)",)),
    (r"vas(t(us)?)?_?m(ed(ialis|ius)?)?|vm(o)?", (r"(vas(tus)?_?med(ialis|ius)?\d*|vm)",)),
    (r"vas(t(us)?)?_?l(at(eralis)?)?|vl", (r"(vas(tus)?_?lat(eralis)?\d*|vasti|vl)",)),
    (r"vas(t(us|i)?)?|quads?(riceps)?", (r"(vas(tus)?_?(lat|med|int)\w*|vasti)",)),
    (
        r"bi?(c(eps)?)?_?f(em(oris)?)?(_?l(h|ong)?)?|bf|lat(eral)?_?ham(s(trings?)?)?|lh|lhs",
        (BICEPS_LONG,),
    ),
    (r"semi_?t(en(d(in(os|o)?us)?)?)?|semitendinous|st", (SEMITENDINOSUS,)),
    (r"semi_?m(em(br(anosus)?)?)?|sm", (SEMIMEMBRANOSUS,)),
    (r"med(ial)?_?ham(s(trings?)?)?|mh|mhs", (SEMITENDINOSUS, SEMIMEMBRANOSUS)),
    (r"ham(s(trings?)?)?|isc(h(io)?)?", (BICEPS_LONG, SEMITENDINOSUS, SEMIMEMBRANOSUS)),
    (
        r"gas(t(roc(nemius)?)?)?_?m(ed(ial(is)?)?)?|med(ial)?_?gas(t(roc(nemius)?)?)?|mg",
        (MEDIAL_GASTROCNEMIUS,),
    ),
    (
        r"gas(t(roc(nemius)?)?)?_?l(at(eral(is)?)?)?|lat(eral)?_?gas(t(roc(nemius)?)?)?|gl|lg",
        (LATERAL_GASTROCNEMIUS,),
    ),
    (r"ga(s(t(roc(nemius)?)?)?)?|gas", (MEDIAL_GASTROCNEMIUS, LATERAL_GASTROCNEMIUS)),
    (r"sol(eus)?", (r"sol(eus)?",)),
    (r"tib(ialis)?_?ant(erior)?|ta|tib", (r"(tib(ialis)?_?ant(erior)?|ta)",)),
    (r"tib(ialis)?_?post(erior)?|tp", (r"tib_?post\w*",)),
    (
        r"per(on(eus)?)?_?l(ong(us)?)?|pl|fib(ularis)?_?long(us)?",
        (r"(per(oneus)?|fib(ularis)?)_?long(us)?",),
    ),
    (r"erector(_?spinae)?|es|ercspn|lumbar_?es", (r"ercspn\w*",)),
)
"""A channel's name without its side, and patterns of the models' muscles, without theirs. "GM" is
left out: it stands for a gluteus in one laboratory and for the medial gastrocnemius in another.
"""
ENDING = re.compile(r"[_. ](activation|emg|envelope)$", re.IGNORECASE)
BEGINNING = re.compile(r"^(voltage|emg|analog)\d*[_.: ]+", re.IGNORECASE)
LETTER = re.compile(r"^([RL])([A-Z]{2,})$")


def plain_channel(channel: str) -> tuple[str, str]:
    """Return a channel's name without what amplifiers put before and after it, and its side.

    The side is "" where the name has none. "Voltage.R Tib Ant" is ("Tib_Ant", "right"), "LTA"
    ("TA", "left").
    """
    plain = _stripped(channel)
    base, side = split_side(plain)
    if not side and (found := LETTER.match(plain)) is not None:
        base = found[2]
        side = "right" if found[1] == "R" else "left"
    return base, side


def muscles_of_channels(
    channels: Sequence[str], model: Model, side: str = ""
) -> dict[str, tuple[str, ...]]:
    """Find the model's muscles that each EMG channel was measured on.

    A channel has muscles as far as its name contains muscle and side. "soleus_r" is the muscle of
    that name, "vas_lat_r_activation" the right vastus lateralis whatever the model calls it, "R
    Hams" the right biceps femoris, semitendinosus and semimembranosus; "soleus" without a side is
    not claimed to be either. `side`: "right" or "left", of channels whose names contain none.
    """
    sided = {name: split_side(name) for name in model.muscle_names}
    result: dict[str, tuple[str, ...]] = {}
    for channel in channels:
        whole = _stripped(channel)
        if whole in sided:
            result[channel] = (whole,)
            continue
        base, own_side = plain_channel(channel)
        patterns = _muscle_patterns(base)
        alike = [
            name
            for name, (word, muscle_side) in sided.items()
            if muscle_side == (own_side or side) and any(_is(pattern, word) for pattern in patterns)
        ]
        if alike and (own_side or side):
            result[channel] = tuple(alike)
    return result


def _stripped(channel: str) -> str:
    """Remove from a channel's name what amplifiers put before and after it."""
    return BEGINNING.sub("", ENDING.sub("", channel.strip())).replace(" ", "_")


def _muscle_patterns(name: str) -> tuple[str, ...]:
    """Find the patterns of the models' muscles that a channel is of, by its name without a side."""
    for spelling, patterns in SPELLINGS:
        if _is(spelling, name):
            return patterns
    for _, patterns in SPELLINGS:
        for pattern in patterns:
            if _is(pattern, name):
                return (pattern,)
    return ()


def _is(pattern: str, name: str) -> bool:
    return re.fullmatch(pattern, name, re.IGNORECASE) is not None
