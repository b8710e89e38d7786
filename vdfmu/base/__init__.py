"""What all rooms may use: errors, files, processes, signals, progress, text, tables of TOML, units of measurement."""
