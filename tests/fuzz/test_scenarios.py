"""Scenario and station files that nobody meant, and those that once were a defect."""

from __future__ import annotations

import pytest

from tests.fuzz.rounds import rounds
from tests.fuzz.scenarios import PROPERTIES, check_scenario_file, check_station_file

UNIFORM = b'"name": "x", "arrivals": {"kind": "uniform", "count": 5, "period_s": %s}'
AT = b', "station": {"preset": "thesis-fit", "controllers": {"x": '


@rounds(150, 3000)
@pytest.mark.parametrize("fuzzed", PROPERTIES, ids=lambda each: each.name)
def test_a_file_is_read_or_refused(fuzzed, cases, seed):
    assert fuzzed.run(cases, seed) >= cases


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        (".json", b"{" + UNIFORM % (b"9" * 400) + b"}"),  # no float holds it
        (".json", b"{" + UNIFORM % (b"9" * 5000) + b"}"),  # nor does Python read it
        (".toml", b"name = 'x'\ntime_limit_s = 0x" + b"f" * 5000),  # it reads that, but does not write it
        (".json", b"{" + UNIFORM % b"100" + AT + b'{"y": NaN}}}}'),
        (".json", b"{" + UNIFORM % b"100" + AT + b'{"\\ud800": 1}}}}'),
        (".toml", b"name = 'x'\n[station]\npreset = 'thesis-fit'\ncontrollers = {x = {y = 1979-05-27}}"),
    ],
)  # fmt: skip
def test_what_once_was_a_defect_is_refused(suffix, content):
    check_scenario_file((suffix, content))
    check_station_file((suffix, content))
