"""Let the compiler make what it needs of its own for each platform: minutes the first time, which the tests then save.

Run as ``python tests/prepare.py``; what it makes stays in the cache, where the tests look.
"""

from vdfmu.base.compile import Compilation, compile_libraries
from vdfmu.base.platforms import PLATFORMS

SOURCE = (
    b"#include <math.h>\n#include <stdio.h>\n"
    b'int prepare(char *text, double x) { return snprintf(text, 20, "%g", sin(x)); }\n'
)

if __name__ == "__main__":
    compile_libraries([Compilation("prepare", {"prepare.c": SOURCE}, platform) for platform in PLATFORMS])
