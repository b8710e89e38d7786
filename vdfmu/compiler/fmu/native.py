"""Content of a native FMU, and its build."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.metadata import files as installed_files
from importlib.util import find_spec
from pathlib import Path

from vdfmu.base.cache import keep_built
from vdfmu.base.compile import WRITTEN, Compilation, compile_libraries
from vdfmu.base.errors import FmuError
from vdfmu.base.files import PACKAGE, data_path, pack_zip, read_json, read_member, source_bytes, storing
from vdfmu.base.platforms import THIRD_PARTY, binaries, chosen_platforms
from vdfmu.base.standards import FMI_VERSIONS
from vdfmu.compiler.c.generate import generated_sources
from vdfmu.compiler.fmu.content import CONTENT_PLACES, Content, is_built, terms
from vdfmu.compiler.fmu.description import build_description, document, model_description, model_description_3
from vdfmu.compiler.fmu.documentation import documentation_files
from vdfmu.compiler.fmu.reference_results import reference_files
from vdfmu.compiler.fmu.terminals import icon_files

_RARE = ("derivative.c", "events.c", "exchange.c", "instance.c", "message.c", "state.c")
"""Files of `fmu_src/c` that a step without events does not call: their optimization takes two fifths of the time."""
_CONTENT = CONTENT_PLACES["native"]


def build_native_fmus(contents: Mapping[Path, Content], platforms: Sequence[str] | str | None) -> None:
    """Write the FMUs that are not up to date, for :func:`~vdfmu.base.platforms.chosen_platforms`."""
    names = chosen_platforms(platforms)
    stale = {path: content for path, content in contents.items() if not _up_to_date(path, content, names)}
    sources: dict[Path, dict[str, bytes]] = {}

    def jobs() -> Iterator[Compilation]:
        for path, content in stale.items():
            sources[path] = unit_sources(content)
            files = _as_compiled(sources[path], content.fmi_version)
            for name in names:
                yield Compilation(content.model_name, files, name)

    made = iter(compile_libraries(jobs()))
    for path, content in stale.items():
        libraries = {name: next(made) for name in names}
        with storing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            pack_zip(path, _members(content, sources[path], libraries))
            keep_built(path, content.guid)


def unit_sources(content: Content) -> dict[str, bytes]:
    """Return file name to content of the folder ``sources`` of an FMU.

    With :func:`fmi_headers` next to them, and ``-I.``, all C files compile to the library.
    """
    generated = generated_sources(content.interface, content.guid, adjoints=content.fmi.adjoints)
    return {name: text.encode() for name, text in generated.items()} | _written_sources(content.fmi.prefix)


@lru_cache
def _written_sources(prefix: str) -> dict[str, bytes]:
    """Return file name to content of the C of all units whose FMI functions have this prefix."""
    left_out = {f"{version.prefix}.c" for version in FMI_VERSIONS.values()} - {f"{prefix}.c"}
    files = sorted((data_path("fmu_src") / "c").glob("*.[ch]"))
    return {file.name: source_bytes(file) for file in files if file.name not in left_out}


def _as_compiled(sources: Mapping[str, bytes], fmi_version: str) -> dict[str, bytes]:
    """Return the files of a library. The C code common to all units is one object.

    As one file it compiles in two thirds of the time. With an empty `config.h` the FMI functions do not have the unit's
    name as prefix.
    """
    same = [name for name in _written_sources(FMI_VERSIONS[fmi_version].prefix) if name.endswith(".c")]
    files = {name: text for name, text in sources.items() if name not in same} | fmi_headers(fmi_version)
    joined = "".join(
        f'#pragma clang optimize {"off" if name in _RARE else "on"}\n#line 1 "{name}"\n{sources[name].decode()}\n'
        for name in same
    )
    return files | {"config.h": b"", WRITTEN: joined.encode()}


@lru_cache
def fmi_headers(fmi_version: str) -> dict[str, bytes]:
    """Return file name to content of the FMI headers that come with fmpy.

    An FMU does not contain them, because the standard leaves them to the importer.
    """
    spec = find_spec("fmpy")
    for folder in (spec.submodule_search_locations if spec else None) or ():
        headers = sorted((Path(folder) / "c-code").glob(f"{FMI_VERSIONS[fmi_version].prefix}*.h"))
        if headers:
            return {header.name: source_bytes(header) for header in headers}
    raise FmuError("the headers of FMI are missing in fmpy (folder fmpy/c-code). Install fmpy again.")


def _up_to_date(path: Path, content: Content, platforms: Sequence[str]) -> bool:
    if not is_built(path, content.guid):
        return False
    try:
        inside = read_json(read_member(path, _CONTENT) or b"{}").get("platforms", [])
    except (ValueError, AttributeError):
        return False
    return set(platforms) <= set(inside)


def _members(content: Content, sources: Mapping[str, bytes], libraries: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return path to content of all members of the FMU."""
    fmi, sources = content.fmi, sources if content.sources else {}
    c_files = [name for name in sorted(sources) if name.endswith(".c")]
    about = content.interface, content.guid, content.generation_tool, content.made_by
    root = model_description_3(*about, fmi) if fmi.arrays else model_description(*about, c_files, fmi)
    members = {f"sources/{name}": text for name, text in sources.items()}
    if fmi.build_description and sources:
        build = build_description(c_files, {"DISABLE_PREFIX": "1"}, content.model_name)
        members["sources/buildDescription.xml"] = document(build)
    return {
        **members,
        "modelDescription.xml": document(root),
        **binaries(content.model_name, libraries, content.fmi_version),
        **icon_files(content.interface, fmi),
        **documentation_files(content),
        **reference_files(content),
        "documentation/licenses/license.txt": (_terms_of_unit(content) + _license() + THIRD_PARTY).encode(),
        **content.robot_files,
        _CONTENT: content.to_json(platforms=list(libraries)).encode(),
    }


def _terms_of_unit(content: Content) -> str:
    """Return the terms of a user's unit and the files under vdfmu's licence; empty for units of the package."""
    if content.interface.functions.shipped:
        return ""
    files, rest = "", "The other parts of binaries/"
    if content.sources:
        files = " (sources/unit.c and sources/kernel_*.c)"
        rest = "All other files in sources/, and their parts of binaries/,"
    return f"The unit {content.model_name}{files}: {terms(content.made_by)}\n\n{rest} belong to vdfmu:\n\n"


@lru_cache
def _license() -> str:
    """Return the licence, which an installed package has in its metadata and a source tree at its root."""
    listed = [Path(str(file.locate())) for file in installed_files("vdfmu") or () if file.name == "LICENSE"]
    for place in (*listed, PACKAGE.parent / "LICENSE"):
        if place.is_file():
            return place.read_text(encoding="utf-8")
    raise FmuError("the licence of vdfmu is not among its installed files. Install vdfmu again.")
