"""Tools for all rooms: C libraries, errors, files, processes, signals, progress, text, tables of TOML, units."""
