"""What an arm meets: a body at its tip, a wall, a moving base."""
