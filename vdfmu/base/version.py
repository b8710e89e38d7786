"""The version of the package, and of the layout of its files."""

__version__ = "0.1.0"
FORMAT = 1
"""Layout of robot, scenario and system files and of ``summary.json``: their key ``format``, 1 where it is missing.

A layout that an older vdfmu would read wrongly, or not at all, gets the next number, and what reads older ones.
"""


def format_problem(found: object) -> str:
    """Return what is wrong with the key ``format`` of a file, "" if it can be read."""
    if isinstance(found, int) and not isinstance(found, bool) and 1 <= found <= FORMAT:
        return ""
    known = "1" if FORMAT == 1 else f"1 to {FORMAT}"
    later = isinstance(found, int) and found > FORMAT
    way_out = f"A later vdfmu than this {__version__} wrote it: update vdfmu." if later else "Leave the key out."
    return f"format: expected {known}, got {found!r}. {way_out}"
