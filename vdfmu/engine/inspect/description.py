"""Check of a model description: its schema, its internal references, and fmpy's rules."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from fmpy.validation import validate_model_description
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.engine.fmu.integrator import excess_of
from vdfmu.engine.package.parse import schema_breaches
from vdfmu.engine.rules import Finding, finding, fmpy_finding, line_of

DESCRIPTION = "modelDescription.xml"
REFERENCES = "extra/org.fmi-standard.fmi-ls-ref/"
"""Folder of reference results (FMI-LS-REF)."""
MANIFEST = "fmi-ls-manifest.xml"
"""Name of the manifest of a layered standard, in its folder."""
_SCHEMAS = {"1": "fmi1/fmi", "2": "fmi2/fmi2", "3": "fmi3/fmi3"}
"""Start of the schema's path in fmpy by version of FMI."""
_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")
_CAUSALITIES = {
    "constant": ("output", "local"),
    "fixed": ("structuralParameter", "parameter", "calculatedParameter", "local"),
    "tunable": ("structuralParameter", "parameter", "calculatedParameter", "local"),
    "discrete": ("input", "output", "local"),
    "continuous": ("input", "output", "local", "independent"),
}
"""Variability to the allowed causalities, FMI 2.0 and 3.0."""
_UNKNOWNS = {
    "2": {
        "outputs": "Outputs/Unknown",
        "derivatives": "Derivatives/Unknown",
        "initialUnknowns": "InitialUnknowns/Unknown",
    },
    "3": {
        "outputs": "Output",
        "derivatives": "ContinuousStateDerivative",
        "clockedStates": "ClockedState",
        "initialUnknowns": "InitialUnknown",
        "eventIndicators": "EventIndicator",
    },
}
"""Lists of fmpy's description to the elements of the model structure, by version of FMI."""
_TYPE_ATTRIBUTES = (
    "name",
    "description",
    "quantity",
    "unit",
    "displayUnit",
    "relativeQuantity",
    "min",
    "max",
    "nominal",
    "unbounded",
)
"""Attributes of a type in fmpy."""


def description_faults(root: Any) -> tuple[list[Finding], Any]:
    """Return all violations of the schema and the rules, and fmpy's description, None if the schema is violated.

    fmpy stops at the first dangling reference. These are found here and removed from `root`, so that fmpy can report
    everything else. A violation of the schema ends the check.
    """
    version = str(root.get("fmiVersion"))
    faults = schema_faults(root, f"{_SCHEMAS[version[0]]}ModelDescription.xsd", DESCRIPTION)
    if faults:
        return faults, None
    dangling = _Dangling(root)
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w") as archive:
        archive.writestr(DESCRIPTION, etree.tostring(root, xml_declaration=True, encoding="UTF-8"))
    try:
        model = fmpy.read_model_description(box, validate=False)
        _restore_lines(model, root)
        excess = excess_of(model.numberOfContinuousStates, model.numberOfEventIndicators)
        too_many = [finding("FMI023", f"{line_of(root)}: the model has {excess}", root)] if excess else []
        return [*dangling.faults, *too_many, *_rules(model)], model
    except Exception as error:  # fmpy raises bare exceptions
        text = f"{DESCRIPTION}: cannot be read, an element or attribute is missing or invalid: {error}"
        return dangling.faults or [finding("FMI003", text, root)], None


@lru_cache
def _schema(name: str) -> Any:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema" / name))


def schema_faults(root: Any, name: str, where: str) -> list[Finding]:
    """Return the violations of one of fmpy's schemas, such as ``fmi2/fmi2ModelDescription.xsd``."""
    return schema_breaches(_schema(name), root, "FMI003", where)


def variables_of(root: Any) -> Iterator[tuple[Any, Any]]:
    """Yield two elements per variable: its own, and the one with the attributes of its type, which FMI 3.0 merges."""
    for item in root.iterfind("ModelVariables/*"):
        if item.get("name") is not None:
            yield item, next((c for c in item if item.tag == "ScalarVariable" and c.tag in _TYPES), item)


def types_of(root: Any) -> dict[str, Any]:
    """Return the elements with the attributes of the defined types, by name."""
    three = str(root.get("fmiVersion")).startswith("3")
    items = (item for item in root.iterfind("TypeDefinitions/*") if three or len(item))
    return {item.get("name"): item if three else item[0] for item in items}


def _restore_lines(model: Any, root: Any) -> None:
    """Set the file's line numbers in fmpy's objects, because the text that fmpy read may have other lines."""
    for variable, (item, _) in zip(model.modelVariables, variables_of(root), strict=False):
        variable.sourceline = item.sourceline
    for name, path in _UNKNOWNS.get(str(root.get("fmiVersion"))[0], {}).items():
        items = root.iterfind(f"ModelStructure/{path}")
        for unknown, item in zip(getattr(model, name), items, strict=False):
            unknown.sourceline = item.sourceline
    for variable in model.modelVariables:
        if variable.alias is not None:
            variable.sourceline = variable.alias.sourceline


def _rules(model: Any) -> list[Finding]:
    """Return fmpy's findings, without its wrong ones on aliases of FMI 3.0 in the model structure."""
    everything = model.modelVariables
    aliases = [v for v in everything if v.alias is not None]
    model.modelVariables = [v for v in everything if v.alias is None]
    texts = validate_model_description(model, validate_model_structure=True)
    names = {v.name for v in model.modelVariables}
    if aliases:
        model.modelVariables = aliases
        texts_of_aliases = validate_model_description(model)
        texts += [text for text in texts_of_aliases if not text.startswith("Exactly one independent variable")]
        twice = [v for v in aliases if v.name in names]
        texts += [f'The variable name "{v.name}" (line {v.sourceline}) is not unique.' for v in twice]
    model.modelVariables = [v for v in everything if not _PLAIN.fullmatch(v.name)]
    if model.modelVariables:
        without_names = validate_model_description(model)
        texts += [t for t in validate_model_description(model, validate_variable_names=True) if t not in without_names]
    model.modelVariables = everything
    return [fmpy_finding(str(text).strip().partition("\n")[0]) for text in dict.fromkeys(texts)]


_IDENTIFIER = r"[A-Za-z_][A-Za-z_0-9]*(\[[0-9]+(,[0-9]+)*\])?"
_PLAIN = re.compile(rf"{_IDENTIFIER}(\.{_IDENTIFIER})*|der\({_IDENTIFIER}(\.{_IDENTIFIER})*(,[0-9]+)?\)")
"""Names that are valid in both naming conventions. All others are checked by fmpy's parser, which is slow."""


class _Dangling:
    """Finds and removes the dangling references of a description, of every kind in fmpy."""

    def __init__(self, root: Any) -> None:
        self.faults: list[Finding] = []
        self.version = str(root.get("fmiVersion"))[0]
        self.variables = list(variables_of(root))
        self.units = {u.get("name") for u in root.iterfind("UnitDefinitions/Unit")}
        self.references = {int(item.get("valueReference")): item for item, _ in self.variables}
        types = types_of(root)
        for kind in root.iterfind("TypeDefinitions/*") if self.version == "3" else ():
            for attribute in set(kind.attrib) - {*_TYPE_ATTRIBUTES}:
                del kind.attrib[attribute]
        for item, value in self.variables:
            declared = value.get("declaredType")
            if declared is not None and declared not in types:
                self.fault("FMI004", item, f"declaredType {declared!r} is not defined; define it in TypeDefinitions")
            kind = types.get(declared or "")
            if declared is not None and (kind is None or kind.tag == "ClockType"):
                del value.attrib["declaredType"]  # fmpy does not read types of clocks
            if self.version != "1":
                self._causality(item, value)
                self._display_unit(item, value, kind)
                self._derivative(item, value)
            if self.version == "3":
                self._references(item)
        for path in _UNKNOWNS.get(self.version, {}).values():
            for item in root.findall(f"ModelStructure/{path}"):
                self._unknown(item)

    def fault(self, rule: str, item: Any, text: str) -> None:
        name = f"variable {item.get('name')!r}" if item.get("name") is not None else item.tag
        self.faults.append(finding(rule, f"{line_of(item)}: {name}: {text}", item))

    def _causality(self, item: Any, value: Any) -> None:
        causality, variability = item.get("causality", "local"), item.get("variability")
        if variability is None:
            variability = "continuous"
            if self.version == "3" and causality.lower().endswith("parameter"):
                variability = "fixed"
            elif self.version == "3" and value.tag not in ("Float64", "Float32"):
                variability = "discrete"
        if causality in _CAUSALITIES[variability] or item.get("initial") is not None:
            return  # reported by fmpy if `initial` is stated
        allowed = [v for v, causalities in _CAUSALITIES.items() if causality in causalities]
        stated = "" if item.get("variability") else " (default)"
        text = f"causality {causality!r} and variability {variability!r}{stated} do not go together; "
        self.fault("FMI006", item, f"{text}expected {' or '.join(allowed)}")
        item.set("variability", allowed[-1])

    def _display_unit(self, item: Any, value: Any, kind: Any) -> None:
        unit = value.get("unit") or (kind.get("unit") if kind is not None else None)
        for holder in (value, *item.iterfind("Alias")):
            shown = holder.get("displayUnit")
            if shown is None or unit in self.units:
                continue
            if unit is None:
                self.fault("FMI005", item, f"has the display unit {shown!r} and no unit; state the unit")
            del holder.attrib["displayUnit"]  # fmpy reports the undefined unit

    def _derivative(self, item: Any, value: Any) -> None:
        text = value.get("derivative")
        if text is not None and not self._exists(int(text)):
            self.fault("FMI007", item, f"derivative={text!r}: {self._expected()}")
            del value.attrib["derivative"]

    def _references(self, item: Any) -> None:
        """Check the clocks and dimensions of a variable of FMI 3.0."""
        if item.get("clocks") is not None:
            kept = self._list(item, "clocks")
            if kept:
                item.set("clocks", " ".join(kept))
            else:
                del item.attrib["clocks"]
        for dimension in item.iterfind("Dimension"):
            text = dimension.get("valueReference")
            if text is None or dimension.get("start") is not None:
                continue
            size = self.references.get(int(text))
            if size is None:
                self.fault("FMI007", item, f"dimension of valueReference {text!r}: {self._expected()}")
            elif not str(size.get("start")).strip().isdigit():
                got = f"got {size.get('name')!r} with start {size.get('start')!r}"
                text = f"dimension of valueReference {text!r}: expected a variable whose start value is a size, {got}"
                self.fault("FMI008", item, text)
            else:
                continue
            del dimension.attrib["valueReference"]
            dimension.set("start", "1")

    def _unknown(self, item: Any) -> None:
        """Check an entry of the model structure and its dependencies."""
        name = "index" if self.version == "2" else "valueReference"
        if not self._exists(int(item.get(name))):
            self.fault("FMI007", item, f"{name}={item.get(name)!r}: {self._expected()}")
            item.getparent().remove(item)
            return
        kinds = (item.get("dependenciesKind") or "").split()
        if item.get("dependencies") is not None:
            before = item.get("dependencies").split()
            kept = self._list(item, "dependencies")
            item.set("dependencies", " ".join(kept))
            if len(kept) < len(before) == len(kinds):
                kinds = kinds[: len(kept)]  # only their number is checked
        if item.get("dependenciesKind") is not None:
            item.set("dependenciesKind", " ".join(kinds))

    def _list(self, item: Any, attribute: str) -> list[str]:
        texts = item.get(attribute).split()
        bad = [text for text in texts if not self._exists(int(text))]
        if bad:
            self.fault("FMI007", item, f"{attribute}: {', '.join(bad)}: {self._expected()}")
        return [text for text in texts if text not in bad]

    def _exists(self, number: int) -> bool:
        return number in self.references if self.version == "3" else 1 <= number <= len(self.variables)

    def _expected(self) -> str:
        if self.version == "3":
            return "no variable has that value reference"
        return f"expected the index of a variable, from 1 to {len(self.variables)}"
