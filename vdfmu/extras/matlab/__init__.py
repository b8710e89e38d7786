"""Results as MATLAB files."""
