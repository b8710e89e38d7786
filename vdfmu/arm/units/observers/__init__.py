"""Observers and filters, one file each: units for what a robot measures or its motors are asked for."""
