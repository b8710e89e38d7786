"""Texts of systems: an SSD and its parts, right or with the faults of a test."""

from vdfmu.engine.package.parse import NAMESPACES

SPACES = " ".join(f'xmlns:{prefix}="{space}"' for prefix, space in NAMESPACES.items())


def ssd(inside: str = "", rest: str = "", attributes: str = "", version: str = "1.0", name: str = "t") -> str:
    return (
        f'<ssd:SystemStructureDescription {SPACES} version="{version}" name="{name}">'
        f'<ssd:System name="s" {attributes}>{inside}</ssd:System>{rest}</ssd:SystemStructureDescription>'
    )


def elements(*items: str) -> str:
    """Return the elements of a system, nothing for none."""
    return f"<ssd:Elements>{''.join(items)}</ssd:Elements>" if any(items) else ""


OWN_STEP = (
    '<ssd:Annotations><ssc:Annotation type="org.vdfmu.experiment"><Experiment xmlns="urn:org.vdfmu:experiment" '
    'communicationStepSize="{}"/></ssc:Annotation></ssd:Annotations>'
)
"""Annotation of a component with its own step [s]."""


def component(name: str = "a", source: str = "a.fmu", inner: str = "", attributes: str = "") -> str:
    return f'<ssd:Component name="{name}" source="{source}" {attributes}>{inner}</ssd:Component>'


def connector_list(connectors: str) -> str:
    """Return connectors written as in "u:input y:output:Real:rad"."""
    items = []
    for text in connectors.split():
        name, kind, *rest = text.split(":")
        unit = f' unit="{rest[1]}"' if len(rest) > 1 else ""
        inner = f"<ssc:{rest[0]}{unit}/>" if rest else ""
        items.append(f'<ssd:Connector name="{name}" kind="{kind}">{inner}</ssd:Connector>')
    return f"<ssd:Connectors>{''.join(items)}</ssd:Connectors>" if items else ""


def connection(text: str, inner: str = "", attributes: str = "") -> str:
    """Return a connection "a.y -> b.u", or "a.y b.u"; an end without a dot is a connector of the system."""
    ends = []
    for label, end in zip(("start", "end"), text.replace("->", " ").split(), strict=True):
        element, _, name = end.rpartition(".")
        ends.append((f'{label}Element="{element}" ' if element else "") + f'{label}Connector="{name}"')
    return f"<ssd:Connection {' '.join(ends)} {attributes}>{inner}</ssd:Connection>"


def connections(*links: str, inner: str = "") -> str:
    return f"<ssd:Connections>{''.join(connection(link, inner) for link in links)}</ssd:Connections>"


def parameter(name: str, value: object = 1, kind: str = "Real", unit: str = "", size: int = 0) -> str:
    unit = f' unit="{unit}"' if unit else ""
    size = f'<ssc:Dimension size="{size}"/>' if size else ""
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"{unit}/>{size}</ssv:Parameter>'


def values(*parameters: str, mapping: str = "", attributes: str = "", version: str = "1.0", name: str = "p") -> str:
    """Return a binding with inline values, `parameters` as "k=1" or whole; `mapping` is entries or whole."""
    items = "".join(each if each[0] == "<" else parameter(*each.split("=")) for each in parameters)
    if mapping.startswith("<ssm:MappingEntry"):
        table = f'<ssm:ParameterMapping version="{version}">{mapping}</ssm:ParameterMapping>'
        mapping = f"<ssd:ParameterMapping>{table}</ssd:ParameterMapping>"
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {attributes}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="{version}" name="{name}"><ssv:Parameters>{items}</ssv:Parameters>'
        f"</ssv:ParameterSet></ssd:ParameterValues>{mapping}</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def binding(source: str, mapping: str = "") -> str:
    inner = f'<ssd:ParameterMapping source="{mapping}"/>' if mapping else ""
    return (
        f'<ssd:ParameterBindings><ssd:ParameterBinding source="{source}">{inner}</ssd:ParameterBinding>'
        "</ssd:ParameterBindings>"
    )
