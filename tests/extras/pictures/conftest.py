"""Runs made up for the pictures."""

from tests.study.report.conftest import made as made
from tests.study.report.conftest import types as types
