"""A scenario as an environment of reinforcement learning, of the interface of gymnasium; one arm, or many at once."""
