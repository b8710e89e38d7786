"""Links and joints as units of their own: an arm is a system of them. They need no robot, only their own numbers."""
