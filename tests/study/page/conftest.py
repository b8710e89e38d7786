"""A browser for the tests of a module, and that it stayed quiet."""

from __future__ import annotations

import pytest

from tests.study.page.browser import Browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture
def quiet(browser):
    """Hold of every test that the console had no error and the page asked for nothing but itself."""
    browser.problems.clear()
    browser.requests.clear()
    yield
    assert browser.problems == []
    assert [url for url in browser.requests if not url.startswith(("data:", "about:", "blob:"))] in ([], browser.asked)
