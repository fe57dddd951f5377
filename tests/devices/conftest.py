"""Ends each haptic-rt that a test of this folder leaves running, as one that fails does."""
import pytest
from drivekit import Controller


@pytest.fixture(autouse=True)
def no_controller_stays():
    del Controller.started[:]
    yield
    for controller in Controller.started:
        controller.kill()
