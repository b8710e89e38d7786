"""Measurements of vdfmu: ``python -m benchmarks``, or ``make bench``.

Times depend on the machine; what counts are the ratios within one run, the fitted exponents and orders, and
the counts of operations, which have no noise at all.
"""
