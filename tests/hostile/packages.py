"""Packages that mean harm: damaged zip files and changed XML, made of two small valid ones."""

import io
import random
import re
import zipfile
from pathlib import Path

from tests.engine.files import check_file
from tests.engine.texts import SPACES
from tests.hostile.table import Corpus
from vdfmu.engine.package.read import load_ssp

_SSD = (
    f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription {SPACES} version="1.0" name="two">
 <ssd:System name="two">
  <ssd:ParameterBindings><ssd:ParameterBinding source="values.ssv"/></ssd:ParameterBindings>
  <ssd:Elements>
   <ssd:Component name="a" type="application/x-fmu-sharedlibrary" source="resources/Gain.fmu">
    <ssd:Connectors>
     <ssd:Connector name="u" kind="input"><ssc:Real unit="N.m"/></ssd:Connector>
     <ssd:Connector name="y" kind="output"><ssc:Real unit="N.m"/></ssd:Connector>
    </ssd:Connectors>
   </ssd:Component>
   <ssd:Component name="b" source="resources/Gain.fmu">
    <ssd:Connectors>
     <ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
     <ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector>
    </ssd:Connectors>
   </ssd:Component>
  </ssd:Elements>
  <ssd:Connections>
   <ssd:Connection startElement="a" startConnector="y" endElement="b" endConnector="u">
    <ssc:LinearTransformation factor="2.0" offset="0.5"/>
   </ssd:Connection>
  </ssd:Connections>
 </ssd:System>
 <ssd:Units><ssd:Unit name="N.m"><ssd:BaseUnit kg="1" m="2" s="-2"/></ssd:Unit></ssd:Units>
 <ssd:DefaultExperiment startTime="0" stopTime="1"/>
</ssd:SystemStructureDescription>
""".replace("<ssd:Unit ", "<ssc:Unit ")
    .replace("</ssd:Unit>", "</ssc:Unit>")
    .replace("ssd:BaseUnit", "ssc:BaseUnit")
)
_SSV = f"""<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet {SPACES} version="1.0" name="values">
 <ssv:Parameters>
  <ssv:Parameter name="a.k"><ssv:Real value="3.0"/></ssv:Parameter>
  <ssv:Parameter name="b.k"><ssv:Real value="-1e-3"/></ssv:Parameter>
 </ssv:Parameters>
</ssv:ParameterSet>
"""
_DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Gain" guid="{1}" numberOfEventIndicators="0">
 <CoSimulation modelIdentifier="Gain" canHandleVariableCommunicationStepSize="true"/>
 <UnitDefinitions><Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit></UnitDefinitions>
 <DefaultExperiment startTime="0.0" stopTime="1.0" stepSize="0.01"/>
 <ModelVariables>
  <ScalarVariable name="u" valueReference="1" causality="input"><Real unit="N.m" start="0.0"/></ScalarVariable>
  <ScalarVariable name="y" valueReference="2" causality="output"><Real unit="N.m"/></ScalarVariable>
  <ScalarVariable name="k" valueReference="3" causality="parameter" variability="tunable">
   <Real start="1.0" min="-10" max="10"/>
  </ScalarVariable>
 </ModelVariables>
 <ModelStructure>
  <Outputs><Unknown index="2" dependencies="1 3" dependenciesKind="dependent fixed"/></Outputs>
  <InitialUnknowns><Unknown index="2" dependencies="1"/></InitialUnknowns>
 </ModelStructure>
</fmiModelDescription>
"""
_TEXTS = {"SystemStructure.ssd": _SSD, "values.ssv": _SSV, "modelDescription.xml": _DESCRIPTION}


def pack(members: dict[str, str | bytes]) -> bytes:
    box = io.BytesIO()
    with zipfile.ZipFile(box, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return box.getvalue()


def package(texts: dict[str, str]) -> bytes:
    fmu = pack({"modelDescription.xml": texts["modelDescription.xml"]})
    return pack(
        {
            "SystemStructure.ssd": texts["SystemStructure.ssd"],
            "values.ssv": texts["values.ssv"],
            "resources/Gain.fmu": fmu,
        }
    )


def _read(data: bytes, folder: Path) -> None:
    """Check a package and load it; neither runs code, for there is no binary."""
    path = folder / "x.ssp"
    path.write_bytes(data)
    check_file(path, run=False)
    load_ssp(path)


def fuzzed_zip(number: int, folder: Path) -> None:
    """Change some bytes of a package, or cut it off, or append to it."""
    dice = random.Random(number)
    data = bytearray(package(_TEXTS))
    kind = dice.randrange(6)
    if kind == 0:
        del data[dice.randrange(len(data)) :]
    elif kind == 1:
        start = dice.randrange(len(data))
        del data[start : start + dice.randrange(1, 64)]
    elif kind == 2:
        start = dice.randrange(len(data) + 1)
        data[start:start] = dice.randbytes(dice.randrange(1, 64))
    else:  # a central directory is short: half of these changes are in there
        first = data.rindex(b"PK\x01\x02") if kind == 3 else 0
        for _ in range(dice.choice([1, 2, 8, 32])):
            data[dice.randrange(first, len(data))] = dice.randrange(256)
    _read(bytes(data), folder)


_VALUES = [
    "", " ", "0", "-1", "1e999", "-1e999", "nan", "NaN", "INF", "1e-999", "5e-324", "9" * 5000, "0x10", "true", "None",
    "2147483648", "-2147483649", "18446744073709551616", "a" * 100_000, "../../etc/passwd", "/dev/zero", "file:///etc",
    "http://example.org/x.fmu", "resources", "#", "#two", "SystemStructure.ssd", "values.ssv", "\x1b[2J", "\u202e",
    "\u0000", "&#0;", "&#27;[31m", "&a;", "\ud7ff\uf8ff", "a.b.c", "a..b", "[1]", "u[1",
    "%n%s", "{0}", "${x}", "u y k", "1 1 1 1",
]  # fmt: skip


def mutated_xml(number: int, folder: Path) -> None:
    """Change one to three places of one of the three files: values, tags, attributes, whole elements, bytes."""
    dice = random.Random(number)
    name = list(_TEXTS)[number % len(_TEXTS)]
    text = _TEXTS[name]
    for _ in range(dice.choice([1, 1, 2, 3])):
        text = _mutate(text, dice)
    _read(package({**_TEXTS, name: text}), folder)


def _mutate(text: str, dice: random.Random) -> str:
    kind = dice.randrange(8)
    values = list(re.finditer(r'="([^"]*)"', text))
    tags = list(re.finditer(r"<[^>]*>", text))
    if kind < 3 and values:
        place = dice.choice(values)
        return text[: place.start(1)] + dice.choice(_VALUES) + text[place.end(1) :]
    if kind == 3 and tags:  # one element goes, or comes twice
        place = dice.choice(tags)
        return text[: place.start()] + place[0] * dice.choice([0, 2, 50]) + text[place.end() :]
    if kind == 4 and len(values) > 1:  # two values change places
        a, b = sorted(dice.sample(values, 2), key=lambda match: match.start())
        return text[: a.start(1)] + b[1] + text[a.end(1) : b.start(1)] + a[1] + text[b.end(1) :]
    if kind == 5:  # a name changes everywhere
        names = sorted(set(re.findall(r"[A-Za-z]{3,}", text)))
        return text.replace(dice.choice(names), dice.choice([*names, "x" * 300, "é", ""]))
    if kind == 6:  # something comes in
        place = dice.randrange(len(text))
        return text[:place] + dice.choice(["<", ">", "&", "\0", "]]>", "<!--", "<![CDATA[", _BOMB]) + text[place:]
    attribute = dice.choice(values) if values else None
    if attribute is None:
        return text[::-1]
    return text[: attribute.end()] + f' extra="{dice.choice(_VALUES)}"' + text[attribute.end() :]


_BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c SYSTEM "file:///etc/passwd">]>'

CORPORA = [
    Corpus("zip files with changed bytes", 250, fuzzed_zip, quick=50),
    Corpus("XML with changes (SSD, SSV, modelDescription)", 3000, mutated_xml, quick=90),
]
