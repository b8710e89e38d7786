"""The world of an arm: a body at its tip, a wall, a moving base."""
