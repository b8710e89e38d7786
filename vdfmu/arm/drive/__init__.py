"""Optional parts of a drive that go beyond the paper, one per file."""
