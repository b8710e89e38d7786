"""The paper's arm: its numbers, equations, units and motions."""
