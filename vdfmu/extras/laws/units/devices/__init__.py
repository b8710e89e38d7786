"""Actuators, sensors and communication, one file each: units between the laws and the plant."""
