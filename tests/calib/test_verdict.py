import numpy as np
import pytest

from weldcell.calib.verdict import Block, Finding, judge, observe, weigh_condition, weigh_outliers, weigh_spare

SHIFT, TURN = Block(name="translation along", frame="flange"), Block(name="rotation about", frame="camera", unit_m=0.25)


def test_condition_number_is_the_ratio_of_singular_values_in_metres():
    jacobian = np.diag([0.25, 0.25, 0.05, 1.0, 1.0, 0.1])  # m/rad, then m/m: scaled 1, 1, 0.2, 1, 1, 0.1
    assert observe(jacobian, [TURN, SHIFT]).condition_number == pytest.approx(10, rel=1e-12)


def test_condition_number_does_not_depend_on_the_unit_of_the_rows():
    jacobian = np.random.default_rng(1).normal(size=(20, 6))
    one, other = observe(jacobian, [TURN, SHIFT]), observe(1e6 * jacobian, [TURN, SHIFT])
    assert other.condition_number == pytest.approx(one.condition_number, rel=1e-9)


def test_an_open_direction_is_named():
    seen = observe(np.diag([1.0, 1.0, 0.0]), [SHIFT])
    assert seen.rank == 2 and np.isinf(seen.condition_number)
    assert seen.weak_directions == ("translation along (0.00, 0.00, 1.00) of the flange",)


def test_fewer_rows_than_parameters_leave_directions_open():
    seen = observe(np.array([[1.0, 0.0, 0.0]]), [SHIFT])
    assert seen.rank == 1 and len(seen.weak_directions) == 2


def test_no_rows_of_information_at_all_is_rank_zero():
    seen = observe(np.zeros((4, 3)), [SHIFT])
    assert seen.rank == 0 and np.isinf(seen.condition_number)


@pytest.mark.parametrize(("smallest", "verdict"), [(0.011, "accepted"), (0.009, "doubtful"), (0.9e-4, "refused")])
def test_condition_is_doubtful_above_a_hundred_and_refused_above_ten_thousand(smallest, verdict):
    seen = observe(np.diag([1.0, 1.0, smallest]), [SHIFT])
    assert judge(weigh_condition(seen, "translation"))[0] == verdict


def test_the_worst_finding_decides_and_stands_first():
    findings = [Finding(verdict="doubtful", reason="a"), Finding(verdict="refused", reason="b")]
    assert judge(findings) == ("refused", ("b", "a"))
    assert judge([]) == ("accepted", ())


def test_an_outlier_is_named_by_its_index():
    (finding,) = weigh_outliers(np.array([1e-4, 1.2e-4, 5e-3, 0.9e-4]), "sight")
    assert finding.reason.startswith("sight 2 ")


def test_exact_data_have_no_outliers():
    assert weigh_outliers(np.array([1e-17, 0.0, 1e-12]), "sight") == []


def test_equations_must_outnumber_unknowns():
    assert [judge(weigh_spare(rows, 6))[0] for rows in (5, 6, 7)] == ["refused", "doubtful", "accepted"]
