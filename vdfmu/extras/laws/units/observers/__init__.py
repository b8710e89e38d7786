"""Observers and filters, one file each: units for measurements and commands."""
