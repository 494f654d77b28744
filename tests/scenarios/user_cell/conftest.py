"""A folder of a user."""

import pytest


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "user"
    home.mkdir()
    return home
