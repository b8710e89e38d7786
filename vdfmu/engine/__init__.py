"""The engine: reading, checking and running of any system of FMUs. It does not depend on robots.

From the rest of the package it imports only errors, files, processes and units of measurement.
"""
