"""The C compiler of what tests compile for this machine: the system's, else the one that makes native FMUs."""

import shutil

from vdfmu.base.platforms import zig

CC = ["cc"] if shutil.which("cc") else [zig(), "cc", "-fno-sanitize=undefined"]
