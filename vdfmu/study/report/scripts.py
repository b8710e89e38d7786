"""Scripts and styles of the pages of runs and studies, which ``make vendor`` packs from ``web`` into ``bundles``."""

from __future__ import annotations

import base64
import gzip
import re
from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.cache import cache_folder, load_or_make
from vdfmu.base.files import data_path
from vdfmu.base.page import compressed, style_sheet
from vdfmu.base.platforms import THIRD_PARTY
from vdfmu.base.text import to_json

_BUNDLES = Path(__file__).parent / "bundles"
_LIBRARIES = "three_uplot.min.js"

_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="7" fill="#0b63c4"/>'
    '<path d="M8 26V14l9-7 8 8" fill="none" stroke="#fff" stroke-width="4" stroke-linejoin="round"/>'
    '<g fill="#f2b632"><circle cx="8" cy="14" r="3"/><circle cx="17" cy="7" r="3"/></g></svg>'
)
"""Icon of the page: an arm."""


def look(*more: str, icon: str = "data:,") -> str:
    """Return the content of a page's head: its icon, the style, light or dark, and `more` style sheets."""
    style = style_sheet() + "".join(map(bundle, ("report.css", *more)))
    return f'<link rel="icon" href="{icon}"><style>{style}</style>'


def run_head(description: str, arm_alone: bool) -> str:
    """Return the content of the head for a page of runs, or of only their arms."""
    sheets = ("uplot.min.css", *(["arm_alone.css"] if arm_alone else []))
    head = look(*sheets, icon=f"data:image/svg+xml,{quote(_ICON)}")
    return f'<meta name="description" content="{escape(description)}">{head}'


@lru_cache
def libraries() -> str:
    """Return the compressed libraries below their licences."""
    text = bundle(_LIBRARIES)

    def read(content: bytes) -> str:
        if gzip.decompress(base64.b64decode(content)) != text.encode():
            raise ValueError("other libraries")
        return content.decode()

    units = THIRD_PARTY.replace("libraries in binaries/", "units that a page simulates")
    licences = "\n".join([*re.findall(r"/\*!(.*?)\*/", text, re.DOTALL), units])
    place = cache_folder() / "pages" / sha256(text.encode()).hexdigest()  # compressing takes 13 ms
    packed = load_or_make(place, lambda: compressed(text.encode()).encode(), read)
    return f'<!--\n{licences}-->\n<script type="text/plain" id="vendor">{packed}</script>'


def data_element(content: Mapping[str, Any]) -> str:
    """Return the elements of a page that contain its data, for ``web/data.js``.

    The content is escaped, so it cannot close the tag.

    Arrays are stored in a separate element, one after another and compressed, as the differences of the integers with
    the numbers' bits, sorted by byte.
    """
    arrays = list[bytes]()

    def placed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: placed(entry) for key, entry in cast("Mapping[str, Any]", value).items()}
        if isinstance(value, list | tuple):
            return [placed(entry) for entry in cast("list[Any]", value)]
        if not isinstance(value, np.ndarray):
            return value
        bits = value.view(f"<u{value.itemsize}")
        changes = np.diff(bits, prepend=bits.dtype.type(0))
        arrays.append(changes.view(np.uint8).reshape(value.size, value.itemsize).T.tobytes())
        return [sum(map(len, arrays[:-1])), value.size]

    inert = to_json(placed(content), indent=None).replace("<", "\\u003c")
    numbers = compressed(b"".join(arrays))
    return (
        f'<script id="data" type="application/json">{inert}</script>\n'
        f'<script id="numbers" type="text/plain">{numbers}</script>'
    )


def scripts_of(name: str) -> list[str]:
    """Return the scripts of a page: its module in ``web`` by name, and the libraries that it adds to the page."""
    return [bundle(f"{name}.js"), *([] if name in ("study", "gallery") else [bundle(_LIBRARIES)])]


def bundle(name: str) -> str:
    """Return a packed script or style."""
    return (_BUNDLES / name).read_text(encoding="utf-8")


def base_module() -> bytes:
    """Return the WebAssembly module shared by all pages: the solver of a communication step, C library functions."""
    return (data_path("fmu_src") / "batch" / "module.wasm").read_bytes()


def packed(values: NDArray[Any], kind: str) -> NDArray[Any]:
    """Return numbers as bytes of a `kind` that pages read: ``<f4``, ``<f8`` or ``<u4``."""
    with np.errstate(over="ignore"):  # values beyond single precision are drawn as gaps
        return np.ascontiguousarray(values, dtype=kind).reshape(-1)
