"""A valid robot and scenario to break."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

from vdfmu.base.files import data_path

MODELS = data_path("models")


def tables(kind: str, name: str) -> dict[str, Any]:
    return tomllib.loads((MODELS / kind / f"{name}.toml").read_text(encoding="utf-8"))


@pytest.fixture
def robot_data():
    return copy.deepcopy(tables("robots", "planar_2dof"))


@pytest.fixture
def scenario_data():
    return copy.deepcopy(tables("scenarios", "planar_tracking"))


@pytest.fixture
def write(tmp_path):
    def value(entry: Any) -> str:
        if isinstance(entry, bool):
            return str(entry).lower()
        if isinstance(entry, str):
            return '"' + entry.replace("\\", "\\\\").replace('"', '\\"') + '"'
        if isinstance(entry, list):
            return "[" + ", ".join(value(item) for item in entry) + "]"
        if isinstance(entry, dict):
            return "{" + ", ".join(f'"{key}" = {value(item)}' for key, item in entry.items()) + "}"
        return repr(entry)

    def writer(name: str, data: dict[str, Any]) -> Path:
        path = tmp_path / name
        path.write_text("".join(f'"{key}" = {value(entry)}\n' for key, entry in data.items()), encoding="utf-8")
        return path

    return writer
