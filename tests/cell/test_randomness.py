"""Random numbers depend on what they are for, not on the order of asking."""

import numpy as np

from weldcell.cell.randomness import generator


def test_the_same_seed_stage_and_frame_give_the_same_numbers():
    assert np.array_equal(generator(3, "seam", 7).normal(size=5), generator(3, "seam", 7).normal(size=5))


def test_seed_stage_and_frame_each_give_other_numbers():
    draws = [generator(*key).normal() for key in ((3, "seam", 7), (4, "seam", 7), (3, "boss", 7), (3, "seam", 8))]
    assert len(set(draws)) == 4
