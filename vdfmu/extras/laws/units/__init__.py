"""Control laws, observers and filters, sensors and actuators: a unit in each file."""
