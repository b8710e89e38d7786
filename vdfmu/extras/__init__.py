"""Extensions of the core of vdfmu. If a folder is deleted with its tests, the core still works; see docs/extras.md.

An extra imports public names of the core, and another extra where docs/extras.md says so.
"""
