"""What vdfmu adds to its core. Each folder can be deleted with its tests, and the core works on; see docs/extras.md.

An extra imports public names of the core, and another extra where docs/extras.md says so.
"""
