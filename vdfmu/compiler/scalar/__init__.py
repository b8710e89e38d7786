"""What the equations run on: elementwise functions of floats, symbols and jets, and elimination."""
