"""Safe reading of XML, and of that of SSP 1.0 against its schemas."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy.ssp
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.errors import SspError

NAMESPACES = {
    prefix: f"http://ssp-standard.org/SSP1/{name}"
    for prefix, name in {
        "ssc": "SystemStructureCommon",
        "ssd": "SystemStructureDescription",
        "ssv": "SystemStructureParameterValues",
        "ssm": "SystemStructureParameterMapping",
        "ssb": "SystemStructureSignalDictionary",
    }.items()
}


def parse_xml(data: bytes, where: str) -> Any:
    """Parse XML without entities, external files or network, and return its root.

    Raises
    ------
    SspError
        The text is not well-formed XML, or has a document type declaration or an XInclude.
    """
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        if b"<!DOCTYPE" in data:  # entities may be what the parser stumbles over
            raise SspError(f"{where}: {_DOCTYPE}") from None
        raise SspError(f"{where}: is not well-formed XML: {error}") from None
    if root.getroottree().docinfo.doctype or root.getroottree().docinfo.internalDTD is not None:
        raise SspError(f"{where}: {_DOCTYPE}")
    include = next(root.iter(f"{{{_XINCLUDE}}}*"), None)
    if include is not None:
        raise SspError(
            f"{where}, line {include.sourceline}: has an XInclude, which is refused; write the text in its place"
        )
    return root


_DOCTYPE = "has a document type declaration, which is refused (entities); remove it"
_XINCLUDE = "http://www.w3.org/2001/XInclude"


@lru_cache
def _schema(kind: str) -> Any:
    name = NAMESPACES[kind].rsplit("/", 1)[1]
    return etree.XMLSchema(file=str(Path(fmpy.ssp.__file__).parent / "schema" / f"{name}.xsd"))


def validate(root: Any, kind: str, where: str) -> None:
    """Check a tree against a schema of SSP 1.0.

    Parameters
    ----------
    root : element
    kind : str
        ``ssd``, ``ssv``, ``ssm`` or ``ssb``.
    where : str
        The name used in messages.
    """
    schema = _schema(kind)
    if not schema.validate(root):
        raise SspError([f"{where}, line {entry.line}: {entry.message}" for entry in schema.error_log])


def parse_ssp_xml(data: bytes, kind: str, where: str) -> Any:
    """Parse and validate one SSP file; `kind` as in `validate`."""
    root = parse_xml(data, where)
    space = etree.QName(root).namespace
    if space != NAMESPACES[kind]:
        raise SspError(f"{where}: expected namespace {NAMESPACES[kind]} (SSP 1.0), got {space}")
    validate(root, kind, where)
    return root
