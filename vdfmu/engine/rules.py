"""The rules of files and findings, one list for reader, master and checker."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from vdfmu.base.errors import SspError
from vdfmu.base.text import elided

Place = tuple[str, int]
"""XML file, with the package before it, and line; empty and 0 if unknown."""


class Rule(NamedTuple):
    """A rule: its requirement, and the fix for a file that breaks it."""

    number: str
    title: str
    way: str
    severity: str = "problem"
    """``problem``, or ``note``: a note neither refuses a run nor makes a check fail."""


class Finding(str):
    """The text on a broken rule, with its place; errors carry it as a string."""

    rule: Rule
    file: str
    """The XML file, with the package before it; may be empty."""
    line: int
    """Line of the file; 0 without a file."""

    def __new__(cls, text: str, rule: Rule, file: str = "", line: int = 0) -> Finding:
        """Make a finding of a text."""
        made = super().__new__(cls, text)
        made.rule, made.file, made.line = rule, file, line
        return made

    def __getnewargs__(self) -> tuple[str, Rule, str, int]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return str(self), self.rule, self.file, self.line

    def reworded(self, text: str) -> Finding:
        """Return the finding in other words."""
        return Finding(text, self.rule, self.file, self.line)

    def within(self, place: str) -> Finding:
        """Return the finding with its place before its text."""
        return self.reworded(f"{place}: {self}") if place else self


def place_of(element: Any) -> Place:
    """Return file and line of an element."""
    return str(element.getroottree().docinfo.URL or ""), element.sourceline or 0


def line_of(element: Any) -> str:
    """Return file and line of an element for messages."""
    file, line = place_of(element)
    return f"{file}, line {line}"


def finding(number: str, text: str, at: Any = ("", 0)) -> Finding:
    """Return the finding that a rule is broken; `at` is its place, or the element of XML."""
    file, line = at if isinstance(at, tuple) else place_of(at)
    return Finding(text, RULES[number], str(file), int(line))


_UNUSABLE = ("FMI001", "FMI002", "FMI017", "FMI018")
"""Rules without which an FMU has nothing to run."""
_anyway: ContextVar[bool] = ContextVar("_anyway", default=False)


@contextmanager
def run_anyway(chosen: bool = True) -> Generator[None]:
    """Make faults of FMUs that can run in spite of them notes in a ``with`` block, so that they refuse no run."""
    token = _anyway.set(chosen)
    try:
        yield
    finally:
        _anyway.reset(token)


def runs_anyway() -> bool:
    """Whether faults of FMUs that can run are notes here, see `run_anyway`."""
    return _anyway.get()


def can_run(problem: str) -> bool:
    """Whether an FMU can run in spite of a problem of its description or its files."""
    number = problem.rule.number if isinstance(problem, Finding) else ""
    return number.startswith("FMI") and number not in _UNUSABLE


def _is_problem(each: Finding) -> bool:
    return each.rule.severity == "problem" and not (runs_anyway() and can_run(each))


def problems_in(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings whose rule makes them problems; see `run_anyway`."""
    return [each for each in findings if _is_problem(each)]


def notes_in(findings: Iterable[Finding]) -> list[Finding]:
    """Return the other findings: notes."""
    return [each for each in findings if not _is_problem(each)]


def breach(number: str, text: str, at: Any = ("", 0)) -> SspError:
    """Return the error of one finding."""
    return SspError(finding(number, text, at))


def fmpy_finding(text: str, reworded: str = "") -> Finding:
    """Return the finding of a message of fmpy on a model description; `reworded` replaces its text."""
    number = next((number for number, word in _FMPY if word in text), "FMI013")
    line = re.search(r"\(line (\d+)\)", text)
    return finding(number, reworded or text, ("modelDescription.xml", int(line[1]) if line else 0))


_FMPY = (
    ("FMI003", "XML"),
    ("FMI003", "Failed to"),
    ("FMI003", "Element '"),
    ("FMI005", "unit"),
    ("FMI012", "unique"),
    ("FMI012", "name"),
    ("FMI011", "same value reference"),
)
"""Rules, and words of fmpy's messages on them."""

_TABLE = """
PKG001 | The file is a zip file that can be read, and all of its entries unpack | export or copy it again
PKG002 | Entries lie inside the package | pack them by relative paths with `/` between folders
PKG003 | Entries are files, not symbolic links | pack the file itself
PKG004 | Sizes and counts of entries are within the limits | pack less, or raise `--unpack-limit`
PKG005 | Entries are stored or deflated, without a password | pack them so
PKG006 | Each name occurs once, also where case does not count, and is not a folder of another | rename one
PKG007 note | No entry is packed twice | pack it once
PKG008 | XML is well-formed | export it again
PKG009 | XML has no document type and no XInclude | write the text in its place
SSP001 | The package has a `SystemStructure.ssd`, or the SSD that is asked for | name one of those it has
SSP002 | A file has the root of its kind | export it as SSP 1.0 or 2.0
SSP003 | A file keeps the schema of its version | correct the line
SSP004 | A file is encoded in UTF-8 | export it in UTF-8
SSP005 note | The version is 1.0 or 2.0 | state one of them
SSP006 note | The SSDs of a package have different names | rename one
SSP007 | Documentation has a `documentation/index.html` | add the page where readers start
SSP008 note | Icons are in the package | add the icon
SSP009 note | The schemas of the version are at hand | `pip install pyssp_standard`
SSP010 | The default experiment, steps and the master that annotations name make sense | correct the value
SSP011 | Files that are named are in the package | add the file, or name another
SSP012 | Sources are relative paths inside the package | put the file into it and name it by its path
SSP013 | A component has a source | name an FMU
SSP014 | A component is an FMU, as its type says | set the type, or write the system into the SSD
SSP016 | A system keeps the limits of size and depth | split or join systems
SSP017 | Elements of a system have different names | rename one
SSP018 | Connectors of an element have different names | rename one
SSP020 | No element refers to a signal dictionary, which is not read | connect the components
SSP021 note | Dotted names of components and variables are unique | rename a component
SSP022 | Units are defined in the file that names them, by finite numbers | define the unit in `Units`
SSP023 | The system has components | add one
SSP030 | A connection joins elements and connectors that exist | correct the name
SSP031 | A connection leads from a source to a sink: table *Allowed connections* | swap or correct its ends
SSP032 | A connector has one source | remove the other connection
SSP033 | The ends of a connection have the same type | convert it in a component
SSP034 | The units of a connection convert into each other | correct the unit, or suppress the conversion
SSP035 | The ends of a connection have the same size, and indices lie in the arrays | correct size or index
SSP036 | A transformation fits the type and has one entry for each value | correct the transformation
SSP037 | Connections through systems form no circle | remove one
SSP038 note | An input has a connection or a value | connect it
SSP039 | Signals pass without an algebraic loop | algorithm `jacobi`, or `iterative`
SSP040 | A connector is a variable of the FMU | correct the name
SSP041 | A connector has the kind of the variable: its causality | correct the kind
SSP042 | A connector has the type of the variable | correct the type
SSP043 | A connector has the unit of the variable | correct the unit
SSP044 | A connector has the size of the variable | correct the dimensions
SSP045 | The FMU has the requested implementation | request another one
SSP046 | An FMU that can be instantiated only once per process is there once | make a copy of the FMU
SSP050 | A parameter binding has values, a mapping has entries, of a type of SSP | name the file, or write them there
SSP051 | A name occurs once in a parameter set, and once as a target of a mapping | keep one
SSP052 | A value is for a variable or connector that exists | correct the name, or `--ignore-unmatched`
SSP053 | A value is for a variable that can be set | set another
SSP054 | A value has the type and size of the variable | correct type or dimensions
SSP055 | The unit of a value converts into the unit of the variable | correct the unit
SSP056 | A value lies within the limits of the variable | choose another
SSP057 note | A value has an effect | remove it
SSP058 note | A connection of different units converts its values | leave `suppressUnitConversion` out
SSP059 note | The signals of the start and of a step have an order, without a loop | see the loop
FMI001 | An FMU is a zip file with a `modelDescription.xml` | export it again
FMI002 | `fmiVersion` is 1.0, 2.0 or 3.0 | state the version
FMI003 | XML keeps the schema of its version | correct the line
FMI004 | Types are defined | define it in `TypeDefinitions`
FMI005 | Units and display units are defined | define the unit in `UnitDefinitions`
FMI006 | Causality, variability and type go together | state an allowed pair
FMI007 | Indices and value references are of variables | correct the number
FMI008 | A dimension is the start value of a variable that is a size | give it a start value
FMI009 | min <= start <= max | correct the value
FMI010 | Variables state start values and `initial` if and only if they must | add or remove it
FMI011 | Variables that share a value reference have the same unit, and one start value | correct the others
FMI012 | Names of variables are unique and of the naming convention | rename one
FMI013 | The model structure is complete | add the entries that are missing
FMI014 | Source files that are listed are there | add them to `sources/`
FMI015 | Terminals name variables | correct the name
FMI016 | The times of the default experiment make sense | correct the value
FMI017 | There is a library for this platform, under the model identifier | build the FMU for it
FMI018 | A library is one of its platform and processor | build the FMU for it
FMI019 note | An FMU has co-simulation | export it for co-simulation
FMI020 | A nominal value is a finite number other than 0 | state the size of the values
FMI021 | The manifest of a layered standard states its name and version | add name or version
FMI022 note | The manifest of FMI-LS-REF gives each related file a source and a role of the standard | correct the entry
FMI023 | The numbers of continuous states and event indicators fit into memory | state those of the model
FMI024 note | An FMU with libraries has the source files that it lists | add them to `sources/`
RUN001 | Ten steps do not fail | see the component's message
RUN002 | A component neither ends its process nor takes too long | debug the component
RUN003 | Reference results can be read, and the unit gives them | correct the table, or the unit
RUN004 note | All reference results are compared | see why not
RUN005 note | All signals are finite | do not read or record it
RUN006 note | The file is run | mend its problems, or `--run-anyway`; leave out `--no-run`
RUN007 | The master can step the system | another master, or another FMU
RUN008 note | An FMU is of FMI 2.0 or 3.0, or of FMI 1.0 for co-simulation | export it so
RUN009 | Inputs can be set, and the calls that an FMU declares work | mend the call, or do not declare it
RUN010 note | The algorithm couples all components with its order of accuracy | see the component
SRC001 | A robot, a scenario, a system or a unit can be read | change the named entry
SRC002 note | No entry of such a file looks like a mistake | see the named entry
"""
"""Number, with "note" for notes; requirement; fix."""


RULES = {
    number: Rule(number, title, way, *severity)
    for head, title, way in (row.split(" | ") for row in _TABLE.strip().splitlines())
    for number, *severity in [head.split()]
}


@dataclass
class Findings:
    """Findings on a file, or on a part of one."""

    entries: list[Finding] = field(default_factory=list[Finding])
    """One sentence or more each, with the place."""
    compared: list[str] = field(default_factory=list[str])
    """Files of reference results inside FMUs whose values were compared."""
    ran: bool = False
    """Whether code of the file was run."""

    @property
    def problems(self) -> list[Finding]:
        """Findings whose rule makes them problems."""
        return problems_in(self.entries)

    @property
    def notes(self) -> list[Finding]:
        """Findings whose rule makes them notes, such as omitted checks with their reason."""
        return notes_in(self.entries)

    def report(self, rule: str, text: str, at: Any = ("", 0)) -> None:
        """Add a finding; for `at` see `finding`."""
        self.entries.append(finding(rule, text, at))

    def add(self, other: Findings, where: str = "", file: str = "") -> None:
        """Add the findings of another check, with its place before each sentence, and `file` before each file."""
        self.ran = self.ran or other.ran
        self.entries += _placed(other.entries, where, file)
        self.compared += [f"{where}: {name}" if where else name for name in other.compared]


def _placed(findings: Iterable[Finding], where: str, file: str) -> Iterable[Finding]:
    for each in findings:
        within = f"{file}: {each.file}".removesuffix(": ") if file else each.file
        yield Finding(each.within(where), each.rule, within, each.line)


def one_line(text: Finding) -> Finding:
    """Return a finding as one line of bounded length, for any text of a parser or unit."""
    return text.reworded(elided("; ".join(line.strip() for line in text.splitlines() if line.strip())))
