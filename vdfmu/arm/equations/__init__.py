"""The paper's equations in plain numpy, one algorithm per file.

Every function is generic in dtype: on float arrays it is the readable reference, on object arrays of symbols
(:mod:`vdfmu.compiler.scalar.symbol`) the same lines are traced into fast code, and on object arrays of jets
(:mod:`vdfmu.compiler.scalar.jet`) they return time derivatives. Nothing here imports FMI, CasADi or a solver.

Conventions: the linear part of a 6-vector comes first; ``U_AB`` maps a force from {B} to {A} and its
transpose a velocity from {A} to {B}, so adjacent frame subscripts match (``V_B = U_AB.T @ V_A``). ``robot`` is a
:class:`vdfmu.arm.robot.Robot`; its fields may be floats or symbols.
"""
