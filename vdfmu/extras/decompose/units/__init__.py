"""Single links and joints: a unit in each file."""
