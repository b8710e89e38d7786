"""Reference solutions of a run by scipy, without FMI and without a master."""
