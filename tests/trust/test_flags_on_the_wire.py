"""The controller's rule for each flag of a sample (docs/controller.md), with flags planted between a running simulation and a hand that presses its
tissue."""
import pytest
from trustkit import play

DOUBT, HELD, UNSTABLE = 8192, 4096, 2048
ENGAGED = 3
# flag: bits of the limits that must be reported, whether the force stays, time until it is zero
RULES = {"none": (0, True, None), "capped": (0, True, None), "overflowed": (DOUBT, True, None), "overran": (0, True, None), "unconverged": (DOUBT, True, None),
         "repeated": (HELD, False, 0.25), "unstable": (UNSTABLE, False, 0.15), "too fast": (DOUBT, True, None), "inside": (DOUBT, True, None), "releasing": (DOUBT, True, None), "cutting": (0, True, None), "unknown": (0, False, 0.25)}


@pytest.fixture(scope="module")
def seen(build):
    return play("relay.py", build)


@pytest.mark.parametrize("flag", RULES)
def test_flag_follows_its_rule(seen, flag):
    said, stays, gone_s = RULES[flag]
    row = seen[flag]
    assert row["pressed_before"] and (flag == "none" or row["planted"] > 10)
    assert row["limits"] & (DOUBT | HELD | UNSTABLE) == said
    for j in range(3):
        assert row["peak"][j] <= 1.3 * row["before"][j] + 200, "felt more than before"
    if stays:
        assert row["state"] == ENGAGED and row["last_felt_s"] > 0.6
    else:
        # a frame until the first planted sample, then the rule's own time, and the delay of this process
        assert row["state"] != ENGAGED and row["last_felt_s"] < gone_s + 0.1


def test_flag_is_reported_and_force_returns(seen):
    assert "the simulation reports that its step failed" in seen["said"] and seen["pressed_at_the_end"]
