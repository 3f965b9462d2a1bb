"""Bodies of inertial sensors by the sensors' names: a body's, a frame's, or a maker's word for a segment."""

from __future__ import annotations

import re
from collections.abc import Mapping

from myomorph.model.errors import BadData, listing, quoted
from myomorph.model.model import Model, index_of
from myomorph.model.segments import Segment, segments_of
from myomorph.model.sides import split_side

SUFFIXES = ("_imu", "_sensor", "_sensors")  # What the name of a sensor may have behind that of its body
WORDS = {
    "lower_trunk": ("pelvis", "sacrum", "lumbar", "waist", "hips"),
    "upper_trunk": ("t8", "sternum", "chest", "torso", "trunk", "thorax"),
    "thigh": ("upperleg", "upleg", "thigh", "femur"),
    "shank": ("lowerleg", "shank", "tibia"),
    "foot": ("foot", "calcn"),
    "upper_arm": ("upperarm", "humerus"),
    "lower_arm": ("forearm", "lowerarm", "ulna", "radius"),
    "hand": ("hand",),
    "head": ("head",),
}  # fmt: skip
"""Labels of Xsens MVN and APDM, and anatomists', by segment: small letters, without side, spaces and number."""
NUMBER, HUMPS = re.compile(r"[ _]\d+$"), re.compile(r"(?<=[a-z])(?=[A-Z])| ")
SEGMENT_OF = {word: segment for segment, words in WORDS.items() for word in words}


def named_bodies(model: Model, names: tuple[str, ...]) -> dict[str, str]:
    """Body of each sensor whose name shows it; of several that name one segment by makers' words, the first's."""
    bodies = {body.name.casefold(): body.name for body in model.bodies}
    frames = {frame.name: frame.body for frame in model.frames}
    result = dict[str, str]()
    for name in names:
        body = frames.get(name) or bodies.get(_plain(name).casefold())
        if body is not None:
            result[name] = body
    parts = _main_bodies(model)
    for name in names:
        word, side = split_side(HUMPS.sub("_", NUMBER.sub("", _plain(name))))
        segment = SEGMENT_OF.get(word.casefold().replace("_", ""))
        body = parts.get(Segment(segment, side)) if segment else None
        if body is not None and name not in result and body not in result.values():
            result[name] = body
    return result


def bodies_of_sensors(model: Model, names: tuple[str, ...], chosen: Mapping[str, str]) -> dict[str, str]:
    """Body of each sensor, as chosen ("" to leave it out), else by its name (`named_bodies`)."""
    for name, body in chosen.items():
        index_of("sensor", name, names, "the recording")
        if body:
            index_of("body", body, model.body_names, "the model")
    known = named_bodies(model, names) | dict(chosen)
    if lost := [name for name in names if name not in known]:
        first = lost[0]
        raise BadData(
            f"sensors {quoted(lost)}: no frame or body of the model is called so; bodies are "
            f"{listing(first, model.body_names)}. "
            f"Name the body of each: --imu-bodies '{first}=BODY' (or '{first}=-' to leave it out)"
        )
    result = {name: known[name] for name in names if known[name]}
    if not result:
        raise BadData("all sensors are left out: name a body for at least one")
    return result


def _plain(name: str) -> str:
    """A sensor's name without what stands for 'sensor' behind it."""
    for suffix in SUFFIXES:
        if name.casefold().endswith(suffix):
            return name[: -len(suffix)]
    return name


def _main_bodies(model: Model) -> dict[Segment, str]:
    """The heaviest body of each segment; none of a model without human segments."""
    try:
        segments = segments_of(model)
    except BadData:
        return {}
    masses = {body.name: body.mass for body in model.bodies}
    return {segment: body for body, segment in sorted(segments.items(), key=lambda part: masses[part[0]])}
