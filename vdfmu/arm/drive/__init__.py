"""Parts of a drive that a robot may have beyond the paper, one a file."""
