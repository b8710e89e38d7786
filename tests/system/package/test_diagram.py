"""The diagram of a system: wires end at connectors and pass no card, and labels do not overlap."""

from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest

from tests.system.package.pictures import NAMES, picture
from vdfmu.system.package.diagram import LETTER, Card, Net, PlacedSystem, arrange

SVG = "{http://www.w3.org/2000/svg}"


def boxes_of(root):
    return [
        (*(float(e.get(key)) for key in ("x", "y")), *(float(e.get(key)) for key in ("width", "height")))
        for e in root.iter(f"{SVG}rect")
    ]


def lines_of(wire):
    path = next(e for e in wire.iter(f"{SVG}path") if e.get("class") == "line").get("d")
    return [[tuple(map(float, point.split())) for point in part.split("L")] for part in path.split("M")[1:]]


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("name", NAMES)
def test_wires_go_from_card_to_card_and_through_none(name, version):
    root = ElementTree.fromstring(picture(name, version))
    boxes = boxes_of(root)
    for (x, y, w, h), (x2, y2, w2, h2) in combinations(boxes, 2):
        assert x + w < x2 or x2 + w2 < x or y + h < y2 or y2 + h2 < y
    for wire in root.iter(f"{SVG}g"):
        for line in lines_of(wire):
            (x, y), (x_end, y_end) = line[0], line[-1]
            # coordinates are written with six digits
            assert any(abs(left + w - x) < 0.01 and top < y < top + h for left, top, w, h in boxes)
            assert any(abs(left - x_end) < 0.01 and top < y_end < top + h for left, top, w, h in boxes)
            for (x1, y1), (x2, y2) in pairwise(line):
                assert abs(x1 - x2) < 0.01 or abs(y1 - y2) < 0.01
                for left, top, w, h in boxes:
                    aside = max(x1, x2) < left + 0.01 or min(x1, x2) > left + w - 0.01
                    assert aside or max(y1, y2) < top or min(y1, y2) > top + h


@pytest.mark.parametrize("name", NAMES)
def test_wires_of_two_vectors_share_no_line(name):
    root = ElementTree.fromstring(picture(name))
    pieces = [
        (k, *sorted(piece)) for k, wire in enumerate(root.iter(f"{SVG}g")) for line in lines_of(wire)
        for piece in pairwise(line)
    ]  # fmt: skip
    for k, first in enumerate(pieces):
        for second in pieces[k + 1 :]:
            if first[0] == second[0]:
                continue
            for axis in (0, 1):
                (a, b), (c, d) = first[1:], second[1:]
                if a[axis] == b[axis] == c[axis] == d[axis]:
                    along = 1 - axis
                    shared = min(b[along], d[along]) - max(a[along], c[along])
                    # the ends of wires to one connector, of which each brings an element, are one line
                    assert shared <= 0 or (along == 0 and b == d), (first, second)


def test_a_vector_is_one_wire_names_have_room_and_components_without_places_stand_with_little_feedback():
    root = ElementTree.fromstring(picture("two_arms"))
    widths = {
        wire.get("data-signal"): "".join(e.text for e in wire.iter(f"{SVG}text") if e.get("class") == "width")
        for wire in root.iter(f"{SVG}g")
    }
    assert widths["plant_2.M_S"] == "6 × 6" and widths["plant.p_O"] == "3" and widths["controller_2.tau"] == "2"
    cards = [Card(name, inputs=["u"] * (name != "a"), outputs=["y"] * (name != "c")) for name in "cba"]
    nets = [Net(("a", "y"), [("b", "u")], ""), Net(("b", "y"), [("c", "u")], "")]
    layout = arrange(cards, nets)
    assert isinstance(layout, PlacedSystem)
    assert [card.column for card in cards] == [2, 1, 0]
    cards = [Card("a", inputs=["u"], outputs=["y"])]
    (wire,) = arrange(cards, [Net(("a", "y"), [("a", "u")], "")]).wires
    (line,) = wire.lines
    assert line[0][0] == cards[0].x + cards[0].width and line[-1][0] == cards[0].x
    # A letter takes at most LETTER of its size in a browser's sans-serif: 0.6 in DejaVu Sans, a wide one.
    root = ElementTree.fromstring(picture("two_arms"))
    boxes = boxes_of(root)
    names = [text for text in root.iter(f"{SVG}text") if text.get("class") in ("name", "soft")]
    assert len(names) > 10
    for text in names:
        x, y = float(text.get("x")), float(text.get("y"))
        ((left, width),) = [(a, w) for a, top, w, h in boxes if a < x < a + w and top < y < top + h]
        assert x + LETTER * 12.0 * len(text.text or "") < left + width
