"""From equations to fast functions: traced once and kept, their derivatives, a step of the solver."""
