"""References of a run by scipy, without FMI and master."""
