"""A browser that stays quiet."""

from tests.study.conftest import browser as browser
from tests.study.page.conftest import quiet as quiet
