"""Links and joints as single units: an arm is a system of them. They need no robot, only their own numbers."""
