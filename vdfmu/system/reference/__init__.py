"""References of a run by scipy, without FMI and without a master, and a witness without a trace."""
