"""From a file to its XML root element, and nothing that is not a plain URDF document."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

from floatplan.errors import InputError
from floatplan.files import LARGEST_URDF, check_depth, read_regular


@dataclass(frozen=True, eq=False)
class UrdfText:
    """A URDF file as read: its text, the SHA-256 of its bytes, and its root element."""

    path: Path
    xml: str
    sha256: str
    root: ElementTree.Element


class _PlainTree(ElementTree.TreeBuilder):
    """Refuses a document type: it is where entities (and entity bombs) are declared, and a URDF needs none."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> NoReturn:
        raise InputError("declares a document type (<!DOCTYPE>), which may hide entities", advice="remove that line")


def read_urdf(path: str | Path) -> UrdfText:
    """Read a URDF file.

    Raises
    ------
    InputError
        If the file is missing, a directory, unreadable, empty, binary, truncated, not XML, or not a ``<robot>``.
    """
    path = Path(path)
    content = read_regular(path, LARGEST_URDF, "a URDF file")
    root = _parse(content, path)
    return UrdfText(path, _text(content, root), hashlib.sha256(content).hexdigest(), root)


def _parse(content: bytes, path: Path) -> ElementTree.Element:
    if not content.strip():
        raise InputError("is empty", source=path)
    parser = ElementTree.XMLParser(target=_PlainTree())
    try:
        parser.feed(content)
        root = parser.close()
        check_depth(root, ElementTree.Element)
    except InputError as error:
        raise error.within(path) from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"is not well-formed XML: {error}", source=path) from None
    if root.tag != "robot":
        raise InputError(f"is not a URDF: its root element is <{root.tag}>, not <robot>", source=path)
    return root


def _text(content: bytes, root: ElementTree.Element) -> str:
    """The document as text; one in another encoding than UTF-8 is written anew."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return ElementTree.tostring(root, encoding="unicode")
