"""Extensions of vdfmu's core, which still works if a folder is deleted with its tests; see docs/extras.md.

An extra imports public names of the core, and other extras only where docs/extras.md allows it.
"""
