"""Single links and joints, one unit per file."""
