"""Control laws, one file each: units that can replace the controller of a system."""
