"""The colours of curves differ for readers of any colour vision, on light and dark pages."""

import itertools
import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from vdfmu.base import page
from vdfmu.study.report.scripts import look

NORMAL = np.eye(3)
PROTANOPIA = np.array(
    [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
)
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""Machado, Oliveira and Fernandes (2009), severity 1: linear sRGB as such readers see it."""
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""Linear sRGB to CIE XYZ (IEC 61966-2-1)."""
SIZE = 0.1
"""Angle at the eye [degrees] that a line and its mark in a legend take: 1 mm from 60 cm."""
NOTICED = np.array([5.079 + 0.751 / SIZE, 5.339 + 1.541 / SIZE, 5.349 + 2.871 / SIZE])
"""Differences of L*, a*, b* that half of all readers notice at that size (Stone, Szafir and Setlur 2014, eq. 6)."""


def linear(colour: str) -> np.ndarray:
    c = np.array(to_rgb(colour))
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    x = XYZ @ np.clip(rgb, 0.0, 1.0) / XYZ.sum(axis=1)
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", [NORMAL, PROTANOPIA, DEUTERANOPIA], ids=["normal", "protanopia", "deuteranopia"])
@pytest.mark.parametrize("colours", [page.LIGHT, page.DARK], ids=["light", "dark"])
def test_each_two_colours_can_be_told_apart(colours, vision):
    seen = {colour: lab(vision @ linear(colour)) for colour in colours}
    for first, second in itertools.combinations(colours, 2):
        # 1 is the difference that half of all readers notice
        assert np.linalg.norm((seen[first] - seen[second]) / NOTICED) > 1.0, (first, second)


@pytest.mark.parametrize(("colours", "scheme"), [(page.LIGHT, 0), (page.DARK, 1)], ids=["light", "dark"])
def test_each_colour_stands_out_from_the_page(colours, scheme):
    card = re.findall(r"--card: (#\w{6})", look())[scheme]
    luminance = [float(XYZ[1] @ linear(colour)) for colour in (card, *colours)]
    for value in luminance[1:]:
        high, low = max(value, luminance[0]), min(value, luminance[0])
        assert (high + 0.05) / (low + 0.05) >= 3.0  # WCAG 2.1, 1.4.11, of graphics
