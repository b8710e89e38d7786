"""Parameters of an arm from a log of its motion: logs, base parameters, estimation, robot files of it."""
