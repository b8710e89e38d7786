"""That a browser stayed quiet."""

import pytest


@pytest.fixture
def quiet(browser):
    """Hold of every test that the console had no error and the page asked for nothing but itself."""
    browser.problems.clear()
    browser.requests.clear()
    browser.asked.clear()
    yield
    assert browser.problems == []
    assert {url for url in browser.requests if not url.startswith(("data:", "about:", "blob:"))} <= {*browser.asked}
