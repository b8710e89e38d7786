"""A native unit computes, saves, refuses and says what the Python unit does: the same tests, the same words.

The fixture ``fmus`` of this folder gives the tests of the Python FMUs native ones. Those that are left out need
pythonfmu's own behaviour, or other words: test_misuse.py and test_state.py here have their like.
"""

# ruff: noqa: F401
from tests.compiler.fmu.test_dependencies import (
    table,
    test_direct_dependencies_are_exactly_what_outputs_change_with_at_a_step,
    test_initial_dependencies_are_exactly_what_outputs_change_with,
    test_torques_set_at_a_communication_point_do_not_move_the_plant_before_its_step,
    test_torques_set_in_initialization_mode_do_not_change_the_start,
)
from tests.compiler.fmu.test_equations import (
    test_the_controller_is_equation_58,
    test_the_feedforward_is_that_of_its_mode,
    test_the_plant_moves_by_its_differential_equation,
    test_the_plant_starts_from_given_values,
    test_the_plant_starts_in_equilibrium,
    test_the_trajectory_at_its_ends_does_not_depend_on_rounding,
    test_the_trajectory_is_equation_57,
)
from tests.compiler.fmu.test_misuse import (
    test_a_call_for_nothing_does_nothing,
    test_a_call_in_the_wrong_phase_is_refused,
    test_a_call_of_the_wrong_type_is_refused,
    test_a_call_sets_all_of_its_values_or_none,
    test_a_fixed_parameter_is_refused_after_initialization,
    test_a_tunable_parameter_takes_effect_at_the_next_step,
    test_a_value_out_of_bounds_is_refused_where_it_is_set,
    test_after_the_end_values_can_be_read_but_nothing_moves,
    test_an_output_cannot_be_set,
    test_infinities_that_cancel_are_not_finite,
    test_numbers_whose_sum_overflows_are_finite,
    test_references_in_any_order_and_twice_are_what_they_name,
    test_rounding_of_the_communication_point_is_no_error,
    test_the_type_is_checked_for_references_that_were_read_before,
    test_values_that_do_not_fit_together_are_refused_in_initialization_mode_too,
)
from tests.compiler.fmu.test_several import (
    test_all_units_and_two_copies_of_each_run_as_if_each_were_alone,
    test_an_instance_lives_on_when_its_copy_is_freed,
    test_two_robots_in_one_process_do_not_meet,
)
from tests.compiler.fmu.test_state import (
    test_a_rollback_near_standstill_restores_the_solver_too,
    test_a_rollback_repeats_the_run_to_the_bit,
    test_a_state_is_a_copy,
    test_a_state_saves_inputs_and_parameters,
    test_a_state_saves_the_phase,
    test_reset_forgets_parameters_that_were_set,
    test_serialization_keeps_every_bit,
)
