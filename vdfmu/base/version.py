"""The version of the package, and of the layout of its files."""

__version__ = "0.1.0"
FORMAT = 1
"""Layout of robot, scenario and system files and of ``summary.json``: their key ``format``, by default 1.

A layout that an older vdfmu would misread, or refuse, gets the next number and readers of the older ones.
"""


def format_problem(number: object) -> str:
    """Return the problem with the key ``format`` of a file, else an empty text."""
    if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= FORMAT:
        return ""
    readable = "1" if FORMAT == 1 else f"1 to {FORMAT}"
    later = isinstance(number, int) and number > FORMAT
    way_out = f"A later vdfmu than this {__version__} wrote it: update vdfmu." if later else "Leave the key out."
    return f"format: expected {readable}, got {number!r}. {way_out}"
