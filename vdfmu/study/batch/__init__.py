"""The program of a system of our own units, compiled as one: in lanes for many runs at once, as a module for a page."""
