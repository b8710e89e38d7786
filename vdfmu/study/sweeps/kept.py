"""The answer and page of a study, cached so that a repeated study does not make them again."""

from __future__ import annotations

import json
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.files import digest_of
from vdfmu.base.sources import source_digest
from vdfmu.study.report.shown_run import NAME
from vdfmu.study.sweeps.answer import Answer
from vdfmu.study.sweeps.plan import Plan
from vdfmu.study.sweeps.table import StudyTable

_BUNDLES = Path(__file__).parents[1] / "report" / "bundles"


class KeptAnswer:
    """The answer of a study and the digest of its page, if the cache has them.

    They are only valid for the same table, scenario, options, code and place of the study.
    """

    def __init__(self, study: StudyTable, plan: Plan) -> None:
        self.page = study.folder / NAME
        self._place = _place_of(study, plan)

    @cached_property
    def _content(self) -> dict[str, Any]:
        return (self._place and load(self._place, json.loads)) or {}

    @property
    def answer(self) -> Answer | None:
        """The answer; None if there is none."""
        content = self._content.get("answer")
        return content and Answer(content["verdict"], tuple(content["sentences"]), content["best"])

    def has_page(self) -> bool:
        """Return whether the page in the folder has exactly the bytes of the cached one."""
        return self.page.is_file() and self._content.get("page") == digest_of(self.page)

    def keep(self, answer: Answer) -> None:
        """Cache an answer, and the digest of the written page."""
        if self._place:
            self._content = {"answer": answer._asdict(), "page": digest_of(self.page)}
            store(self._place, json.dumps(self._content).encode())


def _place_of(study: StudyTable, plan: Plan) -> Path | None:
    """Return the cache key, from everything that determines an answer and a page.

    None for a study whose table, which determines what is run, names another source or options than the plan.
    """
    sources = [json.dumps([facts["source"], facts["options"]]) for facts in (study.facts, plan.facts)]
    if sources[0] != sources[1] or not study.path.is_file():
        return None
    facts = [source_digest("study.sweeps"), np.__version__, str(study.path), digest_of(study.path), *sources]
    facts += [system.scenario for system in plan.job.systems]
    facts += [digest_of(bundle) for bundle in sorted(_BUNDLES.iterdir())]
    return cache_folder() / "studies" / sha256(repr(facts).encode()).hexdigest()
