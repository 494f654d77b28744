"""Cells shared by the tests of this folder; tests put the arm where they need it."""

import numpy as np
import pytest

from weldcell.cell.configuration import CellConfig
from weldcell.cell.world.robot_error import BUDGETS, draw_error
from weldcell.cell.world.scene import build_cell, build_controller, build_parts
from weldcell.models.sensor_head import HeadDesign


@pytest.fixture(scope="session")
def parts():
    return build_parts(CellConfig())


@pytest.fixture(scope="session")
def known_cell(parts):
    return build_cell(parts, HeadDesign(), None)


@pytest.fixture(scope="session")
def controller(known_cell):
    return build_controller(known_cell)


@pytest.fixture(scope="session")
def typical_cell(parts):
    return build_cell(parts, HeadDesign(), draw_error(BUDGETS["typical"], np.random.default_rng(5)))
