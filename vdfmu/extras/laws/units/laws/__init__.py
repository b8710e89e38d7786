"""Control laws, one file each: units that can stand instead of the controller of a system."""
