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
    contacts : estimate contact forces that no plate measured: auto (sites under the model's feet),
        a table of touches (.csv: site, start, stop), or a contact file (.toml); none leaves what
        plates do not carry at the root; by default auto where that is most of the time over 10 %
        of the weight
    measured : what measured forces are used for where contacts are estimated: exact (default;
        contacts only where nothing was measured), shared (each is known for all sites on it
        together) or hidden
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
