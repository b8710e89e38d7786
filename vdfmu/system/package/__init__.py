"""Writing of a scenario's system as a package: SSP 1.0 and 2.0, and for libcosim."""
