"""Tables of runs in LaTeX."""

import re

from tests.study.report.tracking import TRACKING
from vdfmu.extras.compare.latex import sheet_latex, write_tables
from vdfmu.study.report.sheets import Sheet, sheets


def test_tables_are_latex_of_the_same_rows(tmp_path):
    tables = sheets(TRACKING)
    text = write_tables([("", table) for table in tables], tmp_path / "t.tex").read_text()
    assert text.count(r"\begin{table}") == len(tables) == text.count(r"\end{table}")
    assert r"Joint & [deg] & paper & \% &" in text and r" & RMS &  &  & maximum &" in text and r"[N\,m]" in text
    parts = re.findall(r"midrule\n(.*?)\n\\bottomrule", sheet_latex(tables[0]), re.DOTALL)
    lines = zip(*(part.splitlines() for part in parts), strict=True)  # each part begins with the joints
    for line, row in zip(lines, tables[0].rows, strict=True):
        first, *further = (part.removesuffix(r" \\").split(" & ") for part in line)
        assert all(other[0] == first[0] for other in further)
        cells = [*first, *(cell for other in further for cell in other[1:])]
        numbers = [cell.strip("$").replace(r"\cdot 10^{", "e").rstrip("}") for cell in cells]
        assert len(cells) == len(row)
        for shown, number in zip(numbers, row, strict=True):
            assert shown == number or float(shown) == float(number)


def test_words_of_a_table_are_no_commands_of_latex():
    sheet = Sheet("T\n%", ("a_b", "c"), [("50 % & more", "-1.5"), ("\\x{y}^~#$", "1e-300")], ["two\nlines"])
    text = sheet_latex(sheet)
    assert r"\caption{T \%. two lines}" in text and r"a\_b & c \\" in text
    assert r"50 \% \& more & $-1.5$ \\" in text
    assert r"\textbackslash{}x\{y\}\textasciicircum{}\textasciitilde{}\#\$ & $1\cdot 10^{-300}$ \\" in text
