"""Tools for all rooms: C libraries, errors, files, processes, signals, progress, text, tables of TOML, units."""

DOORS = (
    "arrays", "bars", "cache", "compile", "errors", "files", "interrupt", "measure", "option", "page", "platforms",
    "plugins", "process", "progress", "standards", "state_space", "style", "text", "toml_file", "toml_tables",
    "trust", "unpack", "version",
)  # fmt: skip
"""Modules that other rooms import."""
