"""The frame of a groove's plates: there and back, and by hand."""

import numpy as np
import pytest

from weldcell.tracking.plates_frame import PlatesFrame
from weldcell.tracking.section import Section

FRAME = PlatesFrame(origin=np.array([0.003, 0.19]), angle_rad=0.2)


def test_points_come_back_from_the_frame():
    x_m, z_m = FRAME.to_section(*FRAME.from_section(0.011, 0.204))
    assert (x_m, z_m) == pytest.approx((0.011, 0.204), abs=1e-15)  # m: rounding


def test_along_the_plates_there_is_no_depth():
    s_m, d_m = FRAME.from_section(0.003 + 0.01 * np.cos(0.2), 0.19 + 0.01 * np.sin(0.2))
    assert (s_m, d_m) == pytest.approx((0.01, 0.0), abs=1e-15)  # m: rounding


def test_noise_turns_with_the_section():
    """A point moved along its noise by sigma in z moves by the frame's sigma in d, and along the frame's slope."""
    section = Section(
        x_m=np.array([0.005, 0.01]),
        z_m=np.array([0.2, 0.21]),
        sigma_m=np.array([1e-5, 2e-5]),
        noise_slope=np.array([0.1, -0.3]),
        amplitude_grey=np.full(2, np.nan),
    )
    turned = FRAME.of(section)
    s_m, d_m = FRAME.from_section(section.x_m + section.noise_slope * section.sigma_m, section.z_m + section.sigma_m)
    assert d_m - turned.z_m == pytest.approx(turned.sigma_m, abs=1e-15)  # m: rounding
    assert s_m - turned.x_m == pytest.approx(turned.noise_slope * turned.sigma_m, abs=1e-15)
