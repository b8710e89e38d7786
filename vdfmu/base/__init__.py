"""Tools for all packages: C libraries, errors, files, processes, signals, progress, text, TOML tables, units."""
