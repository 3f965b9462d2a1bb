"""Marker protocols: the segment and the anatomical landmark of each label of a recording."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from importlib.resources import files
from typing import Any, Literal, NamedTuple

from myomorph.core.model.errors import BadData, listing
from myomorph.core.model.frozen_map import FrozenMap

SIDES = {"R": "right", "L": "left"}
# The name of the set of names in use in many laboratories, which belongs to no protocol
COMMON = "common"
SETS = 64  # Sets of labels whose meaning is remembered
MIN_COUNT = 6  # So many labels of a recording must be a protocol's for the recording to follow it
MIN_SHARE = 0.3
"""And so large a share of the protocol's landmarks must be there: some names are in every
laboratory's use.
"""
Kind = Literal["bony", "skin", "center"]
_TABLES: Mapping[str, Kind] = {"landmarks": "bony", "skin": "skin", "centers": "center"}
_PREFIX = re.compile(r"^[^:]*:")
_SEPARATORS = re.compile(r"[\s._-]")


class Site(NamedTuple):
    """The part of the body that a marker lies on.

    Attributes
    ----------
    segment : of the body: pelvis, thigh, shank, foot, trunk, head, upper_arm, forearm or hand
    landmark : in words
    side : "right", "left", or "" in the middle
    key : segment and landmark in short, as `pelvis.asis`
    kind : "bony" for a landmark that a finger finds, "skin" for a point without one, "center" for
        the center of a joint
    """

    segment: str
    landmark: str
    side: str
    key: str
    kind: Kind

    def __str__(self) -> str:
        return f"{self.side} {self.landmark}".strip()


@dataclass(frozen=True, eq=False)
class Protocol:
    """A set of labels.

    Attributes
    ----------
    name : in the table
    title : in words
    source : publication or manual
    labels : what each label lies on
    endings : that a label can have in addition
    """

    name: str
    title: str
    source: str
    labels: Mapping[str, Site]
    endings: tuple[str, ...] = ()

    def site(self, label: str) -> Site | None:
        """Find what a label of a recording lies on.

        Parameters
        ----------
        label : as recorded

        Returns
        -------
        None where the protocol does not know it
        """
        return self._plain_labels.get(_plain(label, self.name == COMMON, self.endings))

    @cached_property
    def _plain_labels(self) -> dict[str, Site]:
        """Labels in the form in which they are compared."""
        result: dict[str, Site] = {}
        for label, site in self.labels.items():
            result.setdefault(_plain(label, self.name == COMMON), site)
        return result


@dataclass(frozen=True, eq=False)
class Recognized:
    """Labels of a recording as protocols know them.

    Attributes
    ----------
    protocol : that knows most labels, None for none
    sites : what each known label lies on
    common : labels known by common names only
    unknown : labels that nothing knows
    """

    protocol: Protocol | None
    sites: Mapping[str, Site]
    common: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ProtocolTable:
    """Protocols and landmarks.

    Attributes
    ----------
    landmarks : words and kind, by `segment.key`
    protocols : by name
    common : names in use in many laboratories
    """

    landmarks: Mapping[str, tuple[str, Kind]]
    protocols: Mapping[str, Protocol]
    common: Protocol = field(
        default_factory=lambda: Protocol(
            name=COMMON, title="common names", source="", labels=FrozenMap({})
        )
    )


def find_protocol(names: Iterable[str], table: ProtocolTable | None = None) -> Protocol | None:
    """Find the marker protocol that a recording follows.

    Labels count with or without a subject's name before them (`Subject:LASI`). At least six of
    them, and 30 % of the protocol's landmarks, must be known. Of protocols that know equally many
    labels, the one counts whose labels are all there.

    Parameters
    ----------
    names : labels of the recording
    table : of protocols; None takes those of the package

    Returns
    -------
    None where no protocol knows enough of the labels
    """
    labels = tuple(dict.fromkeys(names))
    table = table or protocols()
    best: Protocol | None = None
    best_score = (MIN_COUNT - 1, 0.0)
    for protocol in table.protocols.values():
        known = {site for site in map(protocol.site, labels) if site is not None}
        count = sum(protocol.site(name) is not None for name in labels)
        score = (count, len(known) / max(1, len(set(protocol.labels.values()))))
        # Markers that only common names know belong to another protocol.
        foreign = sum(
            protocol.site(name) is None and table.common.site(name) is not None for name in labels
        )
        if score > best_score and score[1] >= MIN_SHARE and count >= foreign:
            best = protocol
            best_score = score
    return best


def recognize(names: Iterable[str], table: ProtocolTable | None = None) -> Recognized:
    """Find what every label of a recording lies on: by its protocol, else by common names.

    Two labels never lie on the same landmark: a label of the protocol goes before a common name,
    and of two of the same kind the first counts. Points of the skin may be several.

    Parameters
    ----------
    names : labels of the recording
    table : of protocols; None takes those of the package

    Returns
    -------
    the protocol, and the labels that are known or unknown
    """
    return _recognized(tuple(dict.fromkeys(names)), table or protocols())


@lru_cache(maxsize=SETS)
def _recognized(labels: tuple[str, ...], table: ProtocolTable) -> Recognized:
    """Find what labels lie on; trials of a study have the same ones again and again."""
    protocol = find_protocol(labels, table)
    sites: dict[str, Site] = {}
    common = []
    for source in (protocol, table.common):
        for label in labels:
            site = None if source is None or label in sites else source.site(label)
            if site is None or (site.kind != "skin" and site in sites.values()):
                continue
            sites[label] = site
            if source is table.common:
                common.append(label)
    ordered = {label: sites[label] for label in labels if label in sites}
    return Recognized(
        protocol=protocol,
        sites=FrozenMap(ordered),
        common=tuple(common),
        unknown=tuple(label for label in labels if label not in sites),
    )


def labels_between(
    recorded: Iterable[str], known: Iterable[str], table: ProtocolTable | None = None
) -> dict[str, str]:
    """Match labels of a recording with markers of a model on the same landmark under another name.

    Only bony landmarks and joint centers: a point of the skin without a landmark lies elsewhere in
    every laboratory. Names that both have are left out, and so are markers that the recording has
    under their own name.

    Parameters
    ----------
    recorded : labels of the recording
    known : markers of the model
    table : of protocols; None takes those of the package

    Returns
    -------
    marker by label, as the key `labels` takes them
    """
    recorded = tuple(recorded)
    known = tuple(known)
    taken = set(recorded)
    theirs = {
        site: name for name, site in recognize(known, table).sites.items() if site.kind != "skin"
    }
    result = {}
    for label, site in recognize(recorded, table).sites.items():
        marker = theirs.get(site)
        if marker is not None and marker not in taken and label not in known:
            result[label] = marker
    return result


@cache
def protocols() -> ProtocolTable:
    """Read the protocols that come with the package."""
    text = (files("myomorph.core.motion") / "data" / "protocols.toml").read_text("utf-8")
    return protocol_table(text, "protocols.toml")


def protocol_table(text: str, source: str, base: ProtocolTable | None = None) -> ProtocolTable:
    """Add protocols of a TOML table to those of `base`, or put them in their place.

    Parameters
    ----------
    text : as `data/protocols.toml`, whose first lines describe it
    source : name of the file, for errors
    base : table to add to; None begins with an empty one

    Returns
    -------
    the whole table

    Raises
    ------
    BadData : no TOML, an unknown table, protocol or landmark, or a label that is given twice
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise BadData(f"{source}: is not TOML: {error}") from None
    tables = (*_TABLES, "protocols", COMMON)
    for name in raw:
        if name not in tables:
            raise BadData(f"{source}: unknown table '{name}': there are {listing(name, tables)}")
    landmarks = dict(base.landmarks) if base else {}
    for name, kind in _TABLES.items():
        for segment, markers in raw.get(name, {}).items():
            landmarks |= {f"{segment}.{key}": (str(words), kind) for key, words in markers.items()}
    protocols = dict(base.protocols) if base else {}
    for name, markers in raw.get("protocols", {}).items():
        protocols[name] = _protocol(name, markers, landmarks, protocols, source)
    common = (
        base.common
        if base
        else Protocol(name=COMMON, title="common names", source="", labels=FrozenMap({}))
    )
    if COMMON in raw:
        labels = dict(common.labels) | _labels(
            raw[COMMON].get("labels", {}), landmarks, f"{source}: {COMMON}"
        )
        common = Protocol(name=COMMON, title="common names", source="", labels=FrozenMap(labels))
    return ProtocolTable(FrozenMap(landmarks), FrozenMap(protocols), common)


def _protocol(
    name: str,
    raw: Mapping[str, Any],
    landmarks: Mapping[str, tuple[str, Kind]],
    before: Mapping[str, Protocol],
    source: str,
) -> Protocol:
    """Read a protocol of a TOML table.

    Parameters
    ----------
    name : of the protocol
    raw : its table: title, source, sides, also, endings and labels
    landmarks : words and kind, by `segment.key`
    before : protocols that `also` may name
    source : name of the file, for errors

    Raises
    ------
    BadData : unknown protocols or landmarks, or sides that are not right and left
    """
    where = f"{source}: protocol '{name}'"
    sides = raw.get("sides", SIDES)
    if not isinstance(sides, Mapping) or sorted(sides.values()) != ["left", "right"]:
        raise BadData(
            f"{where}: 'sides' of 'right' and 'left' are expected, as {{ D = \"right\", G ="
            ' "left" }'
        )
    labels: dict[str, Site] = {}
    for other in raw.get("also", ()):
        if other not in before:
            raise BadData(
                f"{where}: unknown protocol '{other}' in 'also': before it are"
                f" {listing(other, list(before))}"
            )
        labels |= before[other].labels
    dropped = {
        name
        for label, key in raw.get("labels", {}).items()
        if not key
        for name, _ in _sided(label, sides)
    }
    labels = {label: site for label, site in labels.items() if label not in dropped}
    labels |= _labels(raw.get("labels", {}), landmarks, where, sides)
    title = str(raw.get("title", ""))
    origin = str(raw.get("source", ""))
    return Protocol(
        name=name,
        title=title or name,
        source=origin,
        labels=FrozenMap(labels),
        endings=tuple(raw.get("endings", ())),
    )


def _labels(
    raw: Mapping[str, str],
    landmarks: Mapping[str, tuple[str, Kind]],
    where: str,
    sides: Mapping[str, str] = SIDES,
) -> dict[str, Site]:
    """Read labels with their sides, and what they lie on.

    Parameters
    ----------
    raw : landmark by label, with `#` for the side's letter
    landmarks : words and kind, by `segment.key`
    where : file and table, for errors
    sides : side by letter

    Returns
    -------
    what each label lies on

    Raises
    ------
    BadData : an unknown landmark, or a label that is given twice
    """
    result: dict[str, Site] = {}
    for label, value in raw.items():
        if not (key := value):
            continue
        stated, _, key = key.rpartition(" ")
        if key not in landmarks or stated not in ("", *SIDES.values()):
            raise BadData(
                f"{where}: unknown landmark '{value}': there are {listing(key, list(landmarks))}"
            )
        words, kind = landmarks[key]
        segment = key.split(".")[0]
        for name, side in _sided(label, sides):
            if name in result:
                raise BadData(f"{where}: label '{name}' is given twice")
            result[name] = Site(
                segment=segment, landmark=words, side=stated or side, key=key, kind=kind
            )
    return result


def _sided(label: str, sides: Mapping[str, str]) -> Iterable[tuple[str, str]]:
    """List the labels that one of a table stands for, with their sides."""
    return (
        [(label.replace("#", letter), side) for letter, side in sides.items()]
        if "#" in label
        else [(label, "")]
    )


def _plain(label: str, loose: bool, endings: Sequence[str] = ()) -> str:
    """Strip a label of the subject's name and the protocol's endings, in small letters.

    `loose` drops separators too.
    """
    text = _PREFIX.sub("", label.strip()).lower()
    for ending in endings:
        text = text.removesuffix(ending.lower())
    return _SEPARATORS.sub("", text) if loose else text
