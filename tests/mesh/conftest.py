import os

import pytest


@pytest.fixture
def env(tmp_path):
    """Gives the test a mesh cache of its own."""
    return dict(os.environ, TM_CACHE_DIR=str(tmp_path / "cache"))


@pytest.fixture
def tm_mesh(bin):
    return bin / "tm-mesh"
