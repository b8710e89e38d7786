"""Tools for all rooms: C libraries, errors, files, processes, signals, progress, text, tables of TOML, units."""

DOORS = (
    "arrays", "bars", "cache", "compile", "csv_file", "domain", "errors", "files", "foreign", "interrupt", "measure",
    "option", "page", "platforms", "plugins", "process", "progress", "standards", "state_space", "style", "text",
    "toml_file", "toml_tables", "trust", "version",
)  # fmt: skip
"""Modules that other rooms import."""
