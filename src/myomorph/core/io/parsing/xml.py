"""XML files read without trusting them: no entities, no network, no document type tricks."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from myomorph.core.io.parsing.door import content_of
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message

ENTITY = re.compile(rb"<!\s*ENTITY", re.IGNORECASE)
DOCTYPE = re.compile(rb"<!\s*DOCTYPE", re.IGNORECASE)
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
TAG = re.compile(r"</?[A-Za-z_][\w.:-]*")
TAG_BYTES = re.compile(TAG.pattern.encode("ascii"))
COLONS = ".colons."
"""Stands for the two colons of OpenSim's inner classes (`HuntCrossleyForce::ContactParameters`),
which no name in XML may have.
"""
AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")


@dataclass(frozen=True, eq=False)
class XmlFile:
    """A parsed document.

    Attributes
    ----------
    root : the outermost element
    path : of the file
    warnings : what the parser had to overlook, one line each
    """

    root: etree._Element
    path: Path
    warnings: tuple[Message, ...] = ()


def read_xml(path: str | os.PathLike[str]) -> XmlFile:
    """Parse an XML file, overlooking a few slips as OpenSim's parser does, and nothing worse.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    the document without comments; `warnings` say what was overlooked

    Raises
    ------
    BadFile : it is absent, too large, empty, declares XML entities, or is not XML after repair
    """
    path = Path(path)
    content = _content(path)
    if declares_entities(content):
        raise BadFile(
            path,
            "declares XML entities, which could expand without end",
            "remove its <!DOCTYPE ...> part",
        )
    if b"::" in content:
        content = TAG_BYTES.sub(_without_colons, content)
    try:
        return XmlFile(_parse(content), path)
    except etree.XMLSyntaxError as error:
        problem = error
    try:
        root = _parse(_tidied(content))
    except etree.XMLSyntaxError as error:
        raise BadFile(path, _said(error), "is the file cut off, or of another kind?") from None
    return XmlFile(
        root,
        path,
        (READING.message(f"not well-formed XML ({_said(problem)}): ignored"),),
    )


def declares_entities(content: bytes) -> bool:
    """Whether a document declares entities, or a type of its own in which it may.

    Each part is looked at once, so that the time grows with the size alone.

    Parameters
    ----------
    content : of the document, in any encoding of XML
    """
    content = content.replace(b"\0", b"")
    if ENTITY.search(content):
        return True
    start = 0
    while doctype := DOCTYPE.search(content, start):
        start = content.find(b">", doctype.end())
        start = len(content) if start < 0 else start
        if b"[" in content[doctype.end() : start]:
            return True
    return False


def with_colons(text: str) -> str:
    """Write the names of OpenSim's inner classes with their colons again.

    Parameters
    ----------
    text : of a document whose elements come of `read_xml`
    """
    if COLONS not in text:
        return text
    return TAG.sub(lambda tag: tag.group().replace(COLONS, "::"), text)


def _without_colons(tag: re.Match[bytes]) -> bytes:
    """Replace two colons in the name of a tag."""
    return tag.group().replace(b"::", COLONS.encode("ascii"))


def _tidied(content: bytes) -> bytes:
    """Take out of a document what careless editors leave in it.

    Odd bytes become blanks, comments and a stray last tag are removed, and a bare & is written as
    an entity.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    text = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
    text = _without_comments(NOT_XML.sub(" ", text))
    if "<OpenSimDocument" not in text:
        text = re.sub(r"</OpenSimDocument>\s*$", "", text)
    return AMPERSAND.sub("&amp;", text).encode("utf-8")


def _without_comments(text: str) -> str:
    """Take the comments out of a text, but for the ends of their lines."""
    parts = []
    start = 0
    while (begin := text.find("<!--", start)) >= 0:
        end = text.find("-->", begin + len("<!--"))
        if end < 0:
            break
        parts += [text[start:begin], "\n" * text.count("\n", begin, end)]
        start = end + len("-->")
    return "".join((*parts, text[start:]))


def _content(path: Path) -> bytes:
    """Read the bytes of a file; `BadFile` where the door refuses it or it is empty."""
    content = content_of(path, "XML")
    if not content.strip():
        raise BadFile(path, "is empty")
    return content


def _parse(content: bytes) -> etree._Element:
    """Parse a document without entities, network, comments and processing instructions."""
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    return etree.fromstring(content, parser)


def _said(error: etree.XMLSyntaxError) -> str:
    """Return the parser's message with the line it is about."""
    line, _ = error.position
    return f"line {line}: {str(error.msg).split(', line ')[0]}"
