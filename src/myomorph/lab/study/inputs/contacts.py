"""Contacts whose forces are unmeasured: a word, or a file that says where and when bodies touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.lab.store.settings import Measured
from myomorph.lab.study.inputs.input import Input, later
from myomorph.lab.study.inputs.keys import KeyKind, WordOrFile

NONE = "none"


@dataclass(frozen=True)
class NothingTouches:
    """Nothing but what was measured touches the body; what is missing stays at its root."""


@dataclass(frozen=True)
class ContactsFile:
    """What is known of contacts.

    Attributes
    ----------
    contacts : contacts whose forces are estimated, as no plate measured them: auto (sites under the
        model's feet), a table of contact intervals (.csv: site, start, stop), a contact file
        (.toml), or none, which leaves unmeasured forces to the root; by default auto where more
        than 10 % of the weight is unmeasured most of the time
    measured : use of measured forces where contacts are estimated: exact (default; contacts only
        where nothing was measured), shared (the sum over all sites on a plate is known) or hidden
        (not used)
    """

    contacts: Annotated[str, WordOrFile(words=("auto", NONE))] = ""
    measured: Annotated[Measured | None, KeyKind(option_of="tension")] = None

    @property
    def estimated(self) -> bool:
        """Whether contact forces are asked for."""
        return self.contacts not in ("", NONE)


INPUT = Input(
    name="contacts",
    settings=ContactsFile,
    open=later("myomorph.lab.study.inputs.contact_file:opened"),
    main="contacts",
)
