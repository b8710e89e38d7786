"""Control laws, observers and filters, sensors and actuators, one unit per file."""
