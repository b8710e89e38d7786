"""The engine: reading, checking and running of any system of FMUs. It does not depend on robots.

It imports nothing of the package but errors, files, processes and units of measurement.
"""
