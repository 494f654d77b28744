"""Degenerate data never give a wrong answer without a word; the benchmark tries 10 000 of them."""

from collections import Counter

import pytest

import degenerate_problems


@pytest.mark.parametrize("solver", range(5))
def test_no_random_degenerate_problem_is_answered_wrongly_and_silently(solver):
    kinds = len(degenerate_problems.KINDS)
    seeds = [kinds * (5 * block + solver) + kind for block in range(6) for kind in range(kinds)]
    outcomes = Counter(degenerate_problems.outcome(seed) for seed in seeds)
    assert outcomes["silent"] == 0 and outcomes["refused"] > len(seeds) / 4
