"""Control laws for the joints of an arm, one unit a file; each may stand in the place of the controller."""
