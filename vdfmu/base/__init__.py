"""Tools for all rooms: errors, files, processes, signals, progress, text, tables of TOML, units of measurement."""

DOORS = (
    "arrays", "bars", "cache", "errors", "files", "interrupt", "measure", "option", "page", "plugins", "process",
    "progress", "standards", "state_space", "style", "text", "toml_file", "toml_tables", "unpack", "version",
)  # fmt: skip
"""Modules that other rooms import."""
