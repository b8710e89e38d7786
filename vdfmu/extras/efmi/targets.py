"""The target of builds."""

from vdfmu.compiler.fmu.build import BuildTarget

TARGETS = {"efmi": BuildTarget("vdfmu.extras.efmi.build", ("double", "float32"))}
