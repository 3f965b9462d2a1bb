"""The model that an MJCF file was written from, stored in it, read while it is unedited."""

from __future__ import annotations

import base64
import binascii
import hashlib
import tempfile
import zlib
from dataclasses import replace
from pathlib import Path

from lxml import etree

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model

NAME = "myomorph"  # Of MuJoCo's custom text that holds the model.
LARGEST = 64 * 1024 * 1024


def put_original(root: etree._Element, model: Model) -> tuple[Message, ...]:
    """Add a model, as OpenSim's file has it, to an MJCF document.

    Parameters
    ----------
    root : outermost element of the document, with all other parts in it
    model : that the document was made of

    Returns
    -------
    what OpenSim's file cannot hold of the model, one line each
    """
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        path = Path(folder) / "model.osim"
        lost = write_osim(model, path)
        content = base64.b64encode(zlib.compress(path.read_bytes(), 9)).decode("ascii")
    digest = _digest(root)
    custom = etree.SubElement(root, "custom")
    etree.SubElement(custom, "text", name=NAME, data=f"{digest} {content}")
    return lost


def original_of(path: Path) -> Model | None:
    """Read the model that a file was written from.

    Parameters
    ----------
    path : of the MJCF file

    Returns
    -------
    the model; None where the file has none or was edited since it was written

    Raises
    ------
    BadFile : the file is no XML, or the model in it is damaged or too large
    """
    root = read_xml(path).root
    held = next((text for text in root.iterfind("custom/text") if text.get("name") == NAME), None)
    if held is None:
        return None
    digest, _, content = held.get("data", "").partition(" ")
    custom = held.getparent()
    if custom is None or len(custom) != 1:
        return None
    root.remove(custom)
    if digest != _digest(root):
        return None
    try:
        packed = zlib.decompressobj()
        document = packed.decompress(base64.b64decode(content, validate=True), LARGEST)
        if packed.unconsumed_tail:
            raise BadFile(path, f"carries a model larger than {LARGEST / 2**20:.0f} MiB")
    except (binascii.Error, zlib.error):
        raise BadFile(
            path, "carries a model that is damaged", f"remove its <text name='{NAME}'>"
        ) from None
    with tempfile.TemporaryDirectory(prefix="myomorph-") as folder:
        written = Path(folder) / "model.osim"
        written.write_bytes(document)
        try:
            return replace(read_osim(written), source=str(path))
        except MyomorphError as error:
            raise BadFile(path, f"carries a model that cannot be read ({error})") from None


def _digest(root: etree._Element) -> str:
    """Hash a document, whatever blanks stand between its elements."""
    return hashlib.sha256(
        etree.canonicalize(etree.tostring(root, encoding="unicode"), strip_text=True).encode()
    ).hexdigest()
