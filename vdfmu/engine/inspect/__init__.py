"""Inspection of FMUs and system packages."""
