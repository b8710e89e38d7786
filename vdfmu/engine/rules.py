"""The rules for files, and findings on files that break them: one list for reader, master and checker."""

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
"""XML file, after the name of its package, and line; empty and 0 if unknown."""


class Rule(NamedTuple):
    """A rule: its requirement, and the fix for a file that breaks it."""

    number: str
    title: str
    way: str
    severity: str = "problem"
    """``problem``, or ``note``: a note does not prevent a run or make a check fail."""


class Finding(str):
    """A message about a broken rule, with its place. It is a string so that errors can contain it."""

    rule: Rule
    file: str
    """The XML file, after the name of its package; may be empty."""
    line: int
    """Line in the file; 0 without a file."""

    def __new__(cls, text: str, rule: Rule, file: str = "", line: int = 0) -> Finding:
        """Return a finding with a text."""
        made = super().__new__(cls, text)
        made.rule, made.file, made.line = rule, file, line
        return made

    def __getnewargs__(self) -> tuple[str, Rule, str, int]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return str(self), self.rule, self.file, self.line

    def reworded(self, text: str) -> Finding:
        """Return the finding with another text."""
        return Finding(text, self.rule, self.file, self.line)

    def within(self, place: str) -> Finding:
        """Return the finding with its place before its text."""
        return self.reworded(f"{place}: {self}") if place else self


def place_of(element: Any) -> Place:
    """Return the file and the line of an element."""
    return str(element.getroottree().docinfo.URL or ""), element.sourceline or 0


def line_of(element: Any) -> str:
    """Return file and line of an element for messages."""
    file, line = place_of(element)
    return f"{file}, line {line}"


def finding(number: str, text: str, at: Any = ("", 0)) -> Finding:
    """Return the finding that a rule is broken; `at` is its place or the XML element."""
    file, line = at if isinstance(at, tuple) else place_of(at)
    return Finding(text, RULES[number], str(file), int(line))


_UNUSABLE = ("FMI001", "FMI002", "FMI017", "FMI018")
"""Rules without which an FMU cannot run at all."""
_anyway: ContextVar[bool] = ContextVar("_anyway", default=False)


@contextmanager
def run_anyway(chosen: bool = True) -> Generator[None]:
    """Within a ``with`` block, treat faults as notes if the FMU can still run, so that they do not prevent a run."""
    token = _anyway.set(chosen)
    try:
        yield
    finally:
        _anyway.reset(token)


def runs_anyway() -> bool:
    """Return whether faults of FMUs that can run are notes here; see `run_anyway`."""
    return _anyway.get()


def can_run(problem: str) -> bool:
    """Return whether an FMU can run despite a problem of its description or its files."""
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
    """Return the finding for fmpy's message about a model description; `reworded` replaces its text."""
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
"""Rules, and the words by which fmpy's messages about them are recognised."""

_TABLE = """
PKG001 | The file is a readable zip file, and all of its entries can be unpacked | export or copy the file again
PKG002 | All entries are inside the package | use relative paths with `/` between folders
PKG003 | Entries are files, not symbolic links | pack the file itself
PKG004 | The sizes and the number of entries are within the limits | pack fewer files, or raise `--unpack-limit`
PKG005 | Entries are stored or deflated, without a password | pack them in this way
PKG006 | Names of entries are unique even if case is ignored, and no file has the name of a folder | rename one
PKG007 note | Each entry is in the package only once | remove the duplicate
PKG008 | The XML is well-formed | export it again
PKG009 | The XML has no document type and no XInclude | replace them by their content
SSP001 | The package has a `SystemStructure.ssd`, or the requested SSD | request one that it has
SSP002 | A file has the root element of its kind | export it as SSP 1.0 or 2.0
SSP003 | A file conforms to the schema of its version | correct the line
SSP004 | A file is encoded in UTF-8 | export it in UTF-8
SSP005 note | The version is 1.0 or 2.0 | write one of them
SSP006 note | The SSDs of a package have different names | rename one
SSP007 | Documentation has a `documentation/index.html` | add this page
SSP008 note | Icons are in the package | add the icon
SSP009 note | The schemas of the version are installed | `pip install pyssp_standard`
SSP010 | The values of the default experiment, of steps and of the master in annotations are valid | correct the value
SSP011 | Referenced files are in the package | add the file, or refer to another
SSP012 | Sources are relative paths inside the package | put the file into the package and write its path
SSP013 | A component has a source | name an FMU
SSP014 | A component is an FMU, and its `type` says so | set the type, or write the system into the SSD
SSP016 | The size and depth of a system are within the limits | split or join systems
SSP017 | Elements of a system have different names | rename one
SSP018 | Connectors of an element have different names | rename one
SSP020 | No element refers to a signal dictionary, which vdfmu does not support | connect the components
SSP021 note | Dotted names of components and variables are unique | rename a component
SSP022 | Units are defined in the file that uses them, with finite numbers | define the unit in `Units`
SSP023 | The system has components | add one
SSP030 | A connection refers to existing elements and connectors | correct the name
SSP031 | A connection leads from a source to a sink: table *Allowed connections* | swap or correct its ends
SSP032 | A connector has only one source | remove the other connection
SSP033 | The type of a connection's source is that of its sink, or converts without loss | convert it in a component
SSP034 | The units of a connection can be converted | correct the unit, or suppress the conversion
SSP035 | The ends of a connection have the same size, and indices are within the arrays | correct size or index
SSP036 | A transformation suits the type and has one entry for each value | correct the transformation
SSP037 | Connections through systems do not form a cycle | remove one
SSP038 note | An input has a connection or a value | connect it
SSP039 | Signals do not form an algebraic loop | use the algorithm `jacobi` or `iterative`
SSP040 | A connector is a variable of the FMU | correct the name
SSP041 | The kind of a connector is the causality of the variable | correct the kind
SSP042 | A connector has the type of the variable | correct the type
SSP043 | A connector has the unit of the variable | correct the unit
SSP044 | A connector has the size of the variable | correct the dimensions
SSP045 | The FMU has the requested implementation | request another one
SSP046 | An FMU that can be instantiated only once per process is used only once | make a copy of the FMU
SSP050 | Parameter bindings have values and mappings have entries, of SSP types | refer to a file, or add them
SSP051 | A name is unique in a parameter set, and among the targets of a mapping | remove the others
SSP052 | A value belongs to an existing variable or connector | correct the name, or use `--ignore-unmatched`
SSP053 | A value belongs to a variable that can be set | set another variable
SSP054 | A value has the type and size of the variable | correct type or dimensions
SSP055 | The unit of a value can be converted to the unit of the variable | correct the unit
SSP056 | A value is within the limits of the variable | choose another value
SSP057 note | A value has an effect | remove it
SSP058 note | A connection between different units converts its values | omit `suppressUnitConversion`
SSP059 note | No algebraic loop has to be solved, at the start or in a step | see the loop
FMI001 | An FMU is a zip file with a `modelDescription.xml` | export it again
FMI002 | `fmiVersion` is 1.0, 2.0 or 3.0 | write the version
FMI003 | The XML conforms to the schema of its version | correct the line
FMI004 | Types are defined | define the type in `TypeDefinitions`
FMI005 | Units and display units are defined | define the unit in `UnitDefinitions`
FMI006 | Causality, variability and type are an allowed combination | choose an allowed combination
FMI007 | Indices and value references belong to variables | correct the number
FMI008 | The variable that sets the size of a dimension has a start value | give it a start value
FMI009 | min <= start <= max | correct the value
FMI010 | Variables have a start value and `initial` exactly where the standard requires them | add or remove it
FMI011 | Variables that share a value reference have the same unit, and one start value | correct the others
FMI012 | Names of variables are unique and follow the naming convention | rename one
FMI013 | The model structure is complete | add the missing entries
FMI014 | Listed source files exist | add them to `sources/`
FMI015 | Terminals refer to variables | correct the name
FMI016 | The times of the default experiment are valid | correct the value
FMI017 | There is a library for this platform, named by the model identifier | build the FMU for this platform
FMI018 | A library is compiled for its platform and processor | build the FMU for this platform
FMI019 note | An FMU supports co-simulation | export it for co-simulation
FMI020 | A nominal value is a finite number other than 0 | write the typical size of the values
FMI021 | The manifest of a layered standard states the name and version of the standard | add them
FMI022 note | Each related file of the manifest of FMI-LS-REF has a source and a standard role | correct the entry
FMI023 | The continuous states and event indicators fit into memory | correct these numbers
FMI024 note | An FMU with libraries contains the source files that it lists | add them to `sources/`
RUN001 | Ten steps do not fail | see the component's message
RUN002 | A component does not end its process or exceed the time limit | debug the component
RUN003 | Reference results can be read, and the unit reproduces them | correct the table, or the unit
RUN004 note | All reference results are compared | see the reason
RUN005 note | All signals are finite | do not read or record the signal
RUN006 note | The check runs the file | correct its problems, or use `--run-anyway`; omit `--no-run`
RUN007 | The master can step the system | use another master, or another FMU
RUN008 note | An FMU has FMI 2.0 or 3.0, or FMI 1.0 for co-simulation | export it for one of them
RUN009 | Inputs can be set, and calls that an FMU declares work | correct the call, or do not declare it
RUN010 note | The algorithm reaches its order of accuracy with all components | see the component
SRC001 | A robot, scenario, system or unit can be read | correct the named entry
SRC002 note | No entry of a robot, scenario, system or unit is likely to be a mistake | see the named entry
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
    """Each is one or more sentences, with their place."""
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
        """Add the findings of another check, with `place` before each sentence and `file` before each file."""
        self.ran = self.ran or other.ran
        self.entries += _placed(other.entries, where, file)
        self.compared += [f"{where}: {name}" if where else name for name in other.compared]


def _placed(findings: Iterable[Finding], where: str, file: str) -> Iterable[Finding]:
    for each in findings:
        within = f"{file}: {each.file}".removesuffix(": ") if file else each.file
        yield Finding(each.within(where), each.rule, within, each.line)


def one_line(text: Finding) -> Finding:
    """Return a finding as one line of bounded length, even with text from a parser or a unit."""
    return text.reworded(elided("; ".join(line.strip() for line in text.splitlines() if line.strip())))
