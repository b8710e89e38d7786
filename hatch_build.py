"""Build hooks of hatchling: the README as an index shows it, and a wheel for one platform with compiled code."""

from __future__ import annotations

import os
import re
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

_SOURCES = '-c constraints.txt ".[native]"'
"""What pip installs in a clone."""
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:)([^)]*)\)")


PREBUILT, TAG = "VDFMU_PREBUILT", "VDFMU_WHEEL_TAG"
"""Variables with the folder of entries of the cache, see ``release.py``, and with the platform of the wheel."""


class PrebuiltWheel(BuildHookInterface):
    """Puts compiled code into a wheel, which is for one platform then. Without the variables a wheel is for all."""

    def initialize(self, version: str, build_data: dict) -> None:
        """Add the folder."""
        if self.target_name == "wheel" and version == "standard" and PREBUILT in os.environ:
            build_data["force_include"][os.environ[PREBUILT]] = "vdfmu/_data/prebuilt"
            build_data["tag"] = f"py3-none-{os.environ[TAG]}"


class IndexReadme(MetadataHookInterface):
    """Gives the metadata the README for an index."""

    def update(self, metadata: dict) -> None:
        """Set ``readme``; [project.urls] in pyproject.toml is the one place that says where the project is."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        home = metadata.get("urls", {}).get("Repository", "")
        metadata["readme"] = {"content-type": "text/markdown", "text": for_index(text, home, metadata["version"])}


def for_index(text: str, home: str, version: str) -> str:
    """Return a text that installs from the index, and whose links lead to a version in a repository.

    Without a repository, links are their words.
    """

    def absolute(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        if home:
            return f"{picture}[{words}]({home}/{'raw' if picture else 'blob'}/v{version}/{target})"
        return "" if picture else words

    return _LINK.sub(absolute, text.replace(_SOURCES, '"vdfmu[native]"'))
