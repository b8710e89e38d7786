"""The seeded faults of `make mutants` fit the package as it is."""

from tests.mutants import faults


def test_each_fault_is_a_line_of_its_file():
    listed = faults()
    assert len(listed) >= 60
    assert all(fault.line != fault.changed for fault in listed)
