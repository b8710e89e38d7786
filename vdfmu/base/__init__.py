"""Tools for all rooms: errors, files, processes, signals, progress, text, tables of TOML, units of measurement."""
