"""The simulated network between two hosts: a counter in LCM messages is delayed, dropped, doubled, reordered and cut as specified."""
import json
import sys
import textwrap

import two_hosts_run

SENDER = """
import lcm, time, struct
link = lcm.LCM()
time.sleep(0.5)
for i in range(400):
    link.publish("COUNT", struct.pack("<qq", i, time.monotonic_ns()))
    time.sleep(0.005)
"""
RECEIVER = """
import lcm, time, struct, json, sys
link = lcm.LCM()
got = []
link.subscribe("COUNT", lambda channel, data: got.append((*struct.unpack("<qq", data), time.monotonic_ns())))
end = time.monotonic() + 3.2
while time.monotonic() < end:
    link.handle_timeout(50)
json.dump(got, open("got.json", "w"))
"""


def counted(name, link):
    python = [sys.executable, "-c"]
    hosts = {"controller": [python + [textwrap.dedent(RECEIVER)]], "simulation": [python + [textwrap.dedent(SENDER)]]}
    directory = two_hosts_run.directory(name)
    result = two_hosts_run.run(directory, hosts, link, 4)
    assert all(code in (0, -2) for code in result["exit"]), (result, [p.read_text() for p in directory.glob("*.log")])
    return json.loads((directory / "got.json").read_text()), result


def test_clean_wire_changes_nothing():
    got, _ = counted("link_clean", {})
    assert [number for number, _, _ in got] == list(range(400))


def test_bad_wire_impairs_as_specified():
    got, result = counted("link_bad", {"delay_ms": 20, "jitter_ms": 4, "drop": 0.1, "double": 0.1, "reorder": 0.05, "seed": 3})
    numbers = [number for number, _, _ in got]
    lost = 400 - len(set(numbers))
    assert 15 <= lost <= 75, f"{lost} of 400 lost at 10 %"
    assert 15 <= len(numbers) - len(set(numbers)) <= 70, "about a tenth comes twice"
    assert any(b < a for a, b in zip(numbers, numbers[1:])), "none out of order"
    assert min(received - sent for _, sent, received in got) >= 20e6, "faster than the wire's delay"
    assert result["count"]["dropped"] >= lost


def test_cut_wire_delivers_nothing():
    got, result = counted("link_cut", {"cut_at_s": 1.5})
    numbers = [number for number, _, _ in got]
    assert 0 < len(numbers) < 380 and numbers == list(range(len(numbers))), "after the cut nothing crosses"
    assert max(sent for _, sent, _ in got) <= 1000 * result["cut_monotonic_us"]
